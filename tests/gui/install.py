"""Installs and enables the extension in this Blender: ``blender -b --python install.py -- ARCHIVE``."""

import sys

import bpy

import addon_utils  # isort: skip

MODULE = "bl_ext.user_default.forest_sensing"

done = bpy.ops.extensions.package_install_files(
    filepath=sys.argv[-1], repo="user_default", enable_on_install=True
)
assert done == {"FINISHED"}, done
assert addon_utils.check(MODULE)[1], "installed but not enabled"
bpy.ops.wm.save_userpref()
