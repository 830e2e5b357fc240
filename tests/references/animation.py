"""Keys of Blender's animations, whose curves lie elsewhere since Blender 4.4 has layers."""


def curves_of(obj):
    """Curves of the keys of an object, or of what else is animated."""
    action = obj.animation_data.action
    if hasattr(action, "fcurves"):
        return action.fcurves
    return action.layers[0].strips[0].channelbags[0].fcurves
