"""Run a scene file in Blender itself: ``blender -b --python headless/in_blender.py -- SCENE.toml``.

A usage line begins with what was typed.

Blender does not look for packages beside a script, so the two packages of this project are loaded from
their folders here. What Blender's own Python lacks comes from the installed extension.
"""

import importlib.util
import shlex
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]


def load_package(name: str) -> None:
    """Make the package in the folder of this name importable."""
    spec = importlib.util.spec_from_file_location(
        name, ROOT / name / "__init__.py", submodule_search_locations=[str(ROOT / name)]
    )
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    spec.loader.exec_module(module)


def run(words: list[str]) -> int:
    """Run the command line; without a command, ``run`` is meant."""
    wanted = ("numpy", "scipy", "cattrs", "laspy", "lazrs", "tqdm")
    lacking = [name for name in wanted if importlib.util.find_spec(name) is None]
    if lacking:
        print(
            f"error: Blender's Python lacks {', '.join(lacking)}; install the Forest Sensing "
            "extension, which brings them, or these packages",
            file=sys.stderr,
        )
        return 2
    load_package("forest_addon")
    load_package("headless")
    from headless import command

    before = [Path(sys.argv[0]).name, *sys.argv[1 : len(sys.argv) - len(words)]]
    command.PROGRAM = shlex.join(before)
    from headless.cli import main

    words = words or ["--help"]
    if words[0].endswith((".toml", ".blend")):
        words = ["run", *words]
    return main(words)


if __name__ == "__main__":
    sys.exit(run(sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else []))
