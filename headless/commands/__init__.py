"""The commands of ``python -m headless`` in the order of its help: words, options, where results go.

The module of the same name beside this table does what a command is asked for, in ``run``; it is imported
then, so that help and a mistyped word are answered at once.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from forest_addon.base.places import ASSETS
from forest_addon.results import POINT_FORMATS
from forest_addon.spec import FORMER, SpecError

from ..command import ONE_OF, Command, finite, name_of, out_file, scene_file, sound_file

CONVERTED = ("semantic-kitti", "s3dis", "coco-panoptic")
POLICIES = ("straight", "gap", "echo", "trained")
DEMO = ASSETS / "scenes" / "demo.toml"
RESUMED = "finished files are kept in {}; --resume goes on with it"

SCENE_HELP = "a scene file (TOML), or the name of one of assets/scenes"
SCENE = {"type": scene_file, "metavar": "SCENE", "help": SCENE_HELP}
SEED = {"type": int, "help": "another seed than the scene file's"}
QUIET = {"action": "store_true", "help": "say nothing but warnings and errors"}
WORKERS = {"type": int, "metavar": "N", "help": "here; default: one a core"}
CLUSTER = {  # on which other machines workers are
    "--scheduler": {"default": "", "metavar": "ADDRESS", "help": "of a Dask cluster"},
    "--slurm": {"metavar": "KEY=VALUE,...", "help": "start workers by Slurm"},
}
RUN = {  # of any run of a scene
    "--seed": SEED,
    "--convolve": {
        "type": sound_file,
        "metavar": "DRY.wav",
        "help": "also write what each reverb makes of this dry sound: NAME-DRY.wav",
    },
    "--resume": {
        "action": "store_true",
        "help": "go on with a run that was ended: sensors that it had finished do not look again",
    },
    ONE_OF: {
        "--quiet": QUIET,
        "--verbose": {"action": "store_true", "help": "say what each audit looked at, and costs"},
    },
    "--json": {"action": "store_true", "help": "in the end, print run.json on standard output"},
    "--strict": {"action": "store_true", "help": "end with exit code 3 where there was a warning"},
}


def share_of(text: str) -> tuple[int, int]:
    """Number and count of the share of the work that "2/8" means."""
    part, _, parts = text.partition("/")
    if not (part.isdigit() and parts.isdigit() and 1 <= int(part) <= int(parts)):
        raise argparse.ArgumentTypeError(f'"{text}" is no share; write such as 2/8')
    return int(part), int(parts)


def per_cent(word: str) -> float:
    """Return the share that a word such as 1% or 0.01 means."""
    value = float(word.removesuffix("%")) / (100 if word.endswith("%") else 1)
    if not 0 < value <= 1:
        raise argparse.ArgumentTypeError(f"{word} is no share of the tiles; write such as 1%")
    return value


def _out_of_run(chosen: argparse.Namespace) -> Path:
    """The folder of a scene; without one, of the .blend file that is open in the Blender that runs this."""
    if chosen.scene is None:
        bpy = sys.modules.get("bpy")
        if bpy is None or not bpy.data.filepath:
            raise SpecError("run", "needs a scene: name a .toml or .blend file")
        chosen.scene = Path(bpy.data.filepath)
    return chosen.out or Path("out") / name_of(chosen.scene)


def _out_of_dataset(chosen: argparse.Namespace) -> Path:
    if chosen.convert is not None:
        if chosen.to is None:
            raise SpecError("--convert", f"needs --to, one of {', '.join(CONVERTED)}")
        return Path(chosen.out or f"{chosen.convert}-{chosen.to}")
    if chosen.out is None and chosen.check is None:
        if chosen.plan is None:
            raise SpecError("dataset", "needs a plan, or --check or --convert and a folder")
        return Path("out") / Path(chosen.plan).stem
    return chosen.out or chosen.check


def _out_of_stand(chosen: argparse.Namespace) -> Path:
    out = chosen.out or Path("out") / name_of(chosen.scene) / "points.csv"
    return out_file(out, ".csv", ".geojson", ".json")


def _out_of_estimate(chosen: argparse.Namespace) -> Path:
    named = chosen.map or chosen.terrain
    if named is None:
        raise SpecError("estimate", "needs a map of trees, or --terrain DEM.tif")
    return out_file(chosen.out or Path("out") / named.stem / "site.toml", ".toml")


def _out_of_convolve(chosen: argparse.Namespace) -> Path:
    beside = chosen.response.parent / f"{chosen.response.stem}-{chosen.dry.stem}.wav"
    return out_file(chosen.out or beside, ".wav")


def _out_of_lidar(chosen: argparse.Namespace) -> Path:
    if chosen.out is not None:
        ends = not chosen.format or chosen.out.name.endswith(f".{chosen.format}")
        return chosen.out if ends else Path(f"{chosen.out}.{chosen.format}")
    if chosen.like:
        return Path("out") / f"like-{chosen.like.stem}.toml"
    name = f"{chosen.blend.stem if chosen.blend else 'scan'}-{Path(chosen.scanner or 'lidar').stem}"
    name = chosen.survey.stem if chosen.survey else name
    return Path("out") / f"{name}.{chosen.format or 'laz'}"


def _kept_of_lidar(chosen: argparse.Namespace) -> str:
    if chosen.like:
        return "nothing was written"
    if chosen.survey:
        return "legs that were finished are kept beside {}"
    return "what was scanned is kept beside {}; --resume goes on with it"


COMMANDS = (
    Command(
        "run",
        help="run a scene file, or the sensors in a .blend file",
        description="Run a scene file, or the sensors that the extension has put into a .blend file.",
        default=_out_of_run,
        whole=True,
        least={"workers": 1},
        kept=RESUMED,
        options={
            "scene": {
                "type": scene_file,
                "nargs": "?",
                "metavar": "SCENE",
                "help": f"{SCENE_HELP}, or a .blend file; in Blender by default the file that is open",
            },
            "--out": {
                "type": Path,
                "metavar": "DIR",
                "help": "folder for the results (default out/SCENE; of a scene.toml or site.toml in DIR "
                "out/DIR-scene, out/DIR-site)",
            },
            **RUN,
            "--workers": {
                "type": int,
                "default": 1,
                "metavar": "N",
                "help": "processes that scan the tiles of a scene with [tiles] (default 1)",
            },
            **CLUSTER,
            "--share": {
                "type": share_of,
                "metavar": "K/N",
                "help": "make every Nth piece from the Kth on, as one of N processes that see the "
                "same folder; "
                "--resume joins them",
            },
            "--store": {
                "metavar": "URL",
                "help": "of a scene with [tiles]: s3://, gs:// or another of fsspec's, to which "
                "finished pieces and "
                "in the end all files are copied; with --resume pieces are taken from there",
            },
        },
    ),
    Command(
        "demo",
        help="run the demo forest",
        description=f"Run the demo forest, assets/scenes/{DEMO.name}.",
        by="commands.run",
        maker="run",
        default="{}",
        whole=True,
        kept=RESUMED,
        fixed={"scene": DEMO, "convolve": ASSETS / "sounds" / "call.wav", "workers": 1}
        | {"share": None, "scheduler": "", "slurm": None, "store": None},
        options={
            "--out": {
                "type": Path,
                "metavar": "DIR",
                "help": "folder for the results (default out/demo)",
            },
            **RUN,
        },
    ),
    Command(
        "dataset",
        help="make thousands of labelled scenes from one plan",
        description="Make the scenes of a plan, each with its truth, into a folder that describes itself.",
        epilog="""\
examples:
  python -m headless dataset tiny --out out/tiny            a plan of assets/plans
  python -m headless dataset my.toml --dry-run              how long, how large
  python -m headless dataset my.toml --out data             on all cores; again: goes on
  python -m headless dataset my.toml --out data --scheduler tcp://host:8786
  python -m headless dataset my.toml --out data --slurm partition=cpu,jobs=40,memory=8GB
  python -m headless dataset my.toml --out data --store s3://forests/data
  python -m headless dataset --convert data --to semantic-kitti --out kitti
  python -m headless dataset --check data                   every hash, every label
  python -m headless dataset my.toml --set count=20 --set scene.sensors[tls].angle_step_deg=0.5

Stop it, kill it: the same command goes on, and the bytes come out the same.
Exit code 4: some scenes could not be made; manifest.csv says why.""",
        outputs=("out", "check"),
        default=_out_of_dataset,
        least={"workers": 1, "shards": 1},
        kept="finished scenes are kept in {}; the same command goes on",
        options={
            "plan": {
                "nargs": "?",
                "metavar": "PLAN",
                "help": "a .toml file, or one of assets/plans",
            },
            "--out": {"type": Path, "metavar": "DIR", "help": "default out/PLAN"},
            "--set": {
                "action": "append",
                "default": [],
                "metavar": "KEY=VALUE",
                "help": "any other key of the plan",
            },
            "--workers": WORKERS,
            **CLUSTER,
            "--dry-run": {
                "action": "store_true",
                "help": "time some scenes, say what all will cost",
            },
            "--replace": {
                "action": "store_true",
                "help": "make scenes anew whose settings changed",
            },
            "--convert": {
                "type": Path,
                "metavar": "DIR",
                "help": "write a made dataset in another format",
            },
            "--to": {
                "metavar": "FORMAT",
                "choices": CONVERTED,
                "help": "of --convert: " + ", ".join(CONVERTED),
            },
            "--check": {"type": Path, "metavar": "DIR", "help": "verify a dataset"},
            "--store": {
                "metavar": "URL",
                "help": "s3://, gs:// or another of fsspec's, to which scenes are copied as they "
                "are finished, in "
                "the end all files; what is there is not made again",
            },
            "--shards": {
                "type": int,
                "metavar": "MB",
                "help": "also pack WebDataset tars of this size",
            },
            "--quiet": {"action": "store_true", "help": "say nothing but errors"},
        },
    ),
    Command(
        "accuracy",
        help="error against seconds for each sensor of a scene, and what to set",
        description="Try settings of each sensor of a scene on a part of it, against the exact "
        "way; draw error "
        "against seconds, and write recommended.toml: the scene with the cheapest settings that keep "
        "the error asked for (metres for LiDAR, a share for sound), or the most exact that fit the time.",
        by="accuracy.run",
        default="{}-accuracy",
        whole=True,
        options={
            "scene": SCENE,
            "--out": {
                "type": Path,
                "metavar": "DIR",
                "help": "folder (default out/SCENE-accuracy)",
            },
            "--error": {
                "type": finite,
                "default": 1e-3,
                "metavar": "E",
                "help": "error wanted (default 1e-3)",
            },
            "--seconds": {
                "type": finite,
                "default": 60.0,
                "metavar": "S",
                "help": "CPU seconds that each sensor may take (default 60)",
            },
        },
    ),
    Command(
        "derive",
        help="print the string of a species' L-system",
        description="Print the string that the L-system of a species makes.",
        outputs=(),
        least={"seed": 0},
        options={
            "species": {"metavar": "PRESET", "help": "a species of assets/species, or a .toml"},
            "--generations": {
                "type": int,
                "metavar": "N",
                "help": "how often it is rewritten (default: as in the file)",
            },
            "--seed": {"type": int, "default": 0, "help": "seed of the chances (default 0)"},
            "--count": {
                "action": "store_true",
                "help": "print the numbers of symbols and branches",
            },
        },
    ),
    Command(
        "template",
        help="make a species from your own tree (STL, PLY, OBJ, glTF)",
        description="Recognise trunk, branches and leaves in files of a tree, and write a species "
        "by which siblings of it grow, pictures of what was recognised and of some siblings, and a "
        "scene that plants them. A table says how close the siblings come to the tree.",
        whole=True,
        default=lambda chosen: chosen.out or Path("out") / chosen.name,
        options={
            "wood": {
                "type": Path,
                "metavar": "WOOD",
                "help": "trunk and branches, and perhaps leaves: .stl, .ply, .obj, .gltf or .glb",
            },
            "leaves": {
                "type": Path,
                "nargs": "?",
                "metavar": "LEAVES",
                "help": "leaves, if in a file of their own",
            },
            "--unit": {
                "default": "",
                "help": "metres, centimetres, millimetres, feet ...; left out: inferred",
            },
            "--up": {
                "default": "",
                "metavar": "AXIS",
                "help": "the files' upright axis, z or y; else inferred",
            },
            "--name": {"required": True, "help": "name of the species"},
            "--height": {
                "type": finite,
                "default": 0.0,
                "metavar": "M",
                "help": "height of the tree in metres; left out: inferred, and said",
            },
            "--grammar": {
                "choices": ("fitted", "tanveer-2020a"),
                "type": lambda word: FORMER.get(word, word),
                "default": "fitted",
                "help": "siblings of the tree, or its branches on Tanveer et al.'s grammar (default fitted)",
            },
            "--siblings": {
                "type": int,
                "default": 50,
                "metavar": "N",
                "help": "how many to grow and compare with the tree, 24 at least (default 50; 0: none)",
            },
            "--accept": {
                "action": "store_true",
                "help": "write the scene even if siblings are too unlike the tree (exit code 5 without)",
            },
            "--out": {
                "type": Path,
                "metavar": "DIR",
                "help": "folder for the library (default out/NAME)",
            },
        },
    ),
    Command(
        "species",
        help="grow one tree of each preset: a table, and with --sheet a contact sheet",
        description="Grow one tree of each species and print its size, leaves and wood.",
        outputs=("sheet", "pictures", "close_ups"),
        is_folder=False,
        least={"seed": 0},
        options={
            "names": {"nargs": "*", "metavar": "NAME", "help": "which; default every preset"},
            "--sheet": {"type": Path, "metavar": "PNG", "help": "also render a contact sheet"},
            "--pictures": {
                "type": Path,
                "metavar": "DIR",
                "help": "also render a small picture of each into a folder",
            },
            "--close-ups": {
                "type": Path,
                "metavar": "DIR",
                "help": "render a fork, bark at a metre and a twig of each NAME into a folder; "
                "without a NAME a "
                "fork of beech, bark of pine and a twig of maple",
            },
            "--pixels": {
                "type": int,
                "default": 800,
                "help": "width of a tree on the sheet (default 800)",
            },
            "--seed": {"type": int, "default": 1, "help": "seed of the trees (default 1)"},
        },
    ),
    Command(
        "stand",
        help="sample where the trees of a scene stand: a table, and a map",
        description="Sample the positions of a scene's trees, without growing them; write them as CSV or "
        "GeoJSON, and a map beside that.",
        is_folder=False,
        default=_out_of_stand,
        options={
            "scene": SCENE,
            "--out": {
                "type": Path,
                "metavar": "FILE",
                "help": ".csv or .geojson (default out/SCENE/points.csv)",
            },
            "--seed": SEED,
        },
    ),
    Command(
        "estimate",
        help="make a scene like a site from a map of its trees",
        description="Estimate where trees stand on a site from a table of x, y and perhaps "
        "species, DBH and height, "
        "and write a scene that plants forests like it, and a picture.",
        is_folder=False,
        default=_out_of_estimate,
        options={
            "map": {"type": Path, "nargs": "?", "metavar": "TREES.csv", "help": "a table of trees"},
            "--terrain": {
                "type": Path,
                "metavar": "DEM.tif",
                "help": "the ground that they stand on; without a map, a scene of bare ground in its middle",
            },
            "--out": {
                "type": Path,
                "metavar": "SITE.toml",
                "help": "the scene (default out/TREES/site.toml)",
            },
            "--method": {
                "choices": ("mixture", "kernel"),
                "default": "mixture",
                "help": "Gaussian hills of maximum likelihood, or a kernel estimate (default mixture)",
            },
            "--law": {
                "choices": ("auto", "poisson", "thomas", "matern", "strauss"),
                "default": "auto",
                "help": "how trees stand about that intensity: by chance, in groups, apart; auto takes the "
                "first that the map's own tests accept (default auto)",
            },
            "--window": {
                "nargs": "+",
                "default": (),
                "metavar": "W",
                "help": "where trees were mapped: X0 Y0 X1 Y1, or a CSV of corners x, y, ring "
                "(default: around the trees)",
            },
            "--species": {
                "action": "append",
                "default": [],
                "metavar": "NAME=PRESET",
                "help": "what to plant for a name of the map, or PRESET alone for all; may be repeated",
            },
            "--crs": {
                "default": "",
                "metavar": "EPSG:N",
                "help": "system of the scene in metres, to which degrees are projected",
            },
        },
    ),
    Command(
        "allometry",
        help="fit height, crown and leaf area over DBH to measured trees, or check grown ones",
        description="fit: fit the laws that trees are grown to measure by, height, crown width, "
        "crown base and leaf "
        "area over the stem's diameter, their spread and correlation, to a table; writes a file a kind. "
        "check: grow trees of a species over the diameters that were measured, and count how many lie "
        "where 90 % of the measured ones do.",
        epilog="""A table has columns species, pft (EG, DG, EA, DA: evergreen or deciduous, gymnosperm or
angiosperm), dbh_m, height_m, crown_width_m, crown_base_m, leaf_area_m2, and perhaps study and
leaf_area_is (half, all or outline: how needles were counted).""",
        options={
            "action": {"choices": ("fit", "check"), "help": "what to do"},
            "what": {"metavar": "TABLE.csv|SPECIES", "help": "of measured trees, or to grow"},
            "--kind": {
                "action": "append",
                "default": [],
                "metavar": "NAME",
                "help": 'fit: a species, genus or functional type of the table, "Picea abies"; may be '
                "repeated (default: those that are shipped)",
            },
            "--source": {"default": "", "help": "fit: where the trees were measured"},
            "--trees": {"type": int, "default": 1000, "help": "check: how many (default 1000)"},
            "--out": {
                "type": Path,
                "default": Path("out/allometry"),
                "metavar": "FOLDER",
                "help": "of fitted files",
            },
        },
    ),
    Command(
        "assets",
        help="grow an asset library: trees to drag from the Asset Browser",
        description="Grow trees of each species into a .blend file of assets, with pictures, tags "
        "and catalogs. Added "
        "to Blender's asset libraries (Preferences, File Paths), they can be dragged into any scene; sensors "
        "know their leaves, branches and species there.",
        outputs=("out", "sheet"),
        least={"seed": 0},
        options={
            "names": {"nargs": "*", "metavar": "SPECIES", "help": "which; default every preset"},
            "--out": {
                "type": Path,
                "default": Path("out/assets"),
                "metavar": "FOLDER",
                "help": "of the library",
            },
            "--variants": {
                "type": int,
                "default": 4,
                "metavar": "N",
                "help": "trees of each species (default 4)",
            },
            "--seed": {"type": int, "default": 1, "help": "seed of the trees (default 1)"},
            "--sheet": {
                "type": Path,
                "metavar": "PNG",
                "help": "also put all pictures on one sheet",
            },
        },
    ),
    Command(
        "canopy",
        help="gap fraction and leaf area index of a stand, by hemispherical pictures",
        description="Grow the forest of a scene file and look up from points in it by rays: gap "
        "fraction by zenith "
        "angle, open sky, effective plant area index (Miller 1967), beside the true leaf and wood area "
        "indices; and hemispherical pictures.",
        default="{}/canopy",
        whole=True,
        options={
            "scene": SCENE,
            "--out": {
                "type": Path,
                "metavar": "FOLDER",
                "help": "for the files (default out/SCENE/canopy)",
            },
            "--at": {
                "action": "append",
                "metavar": "X,Y[,Z]",
                "help": "a point, metres; may be given again (default a grid over the middle of the field)",
            },
            "--grid": {
                "type": int,
                "default": 5,
                "metavar": "N",
                "help": "points along a side of it (default 5)",
            },
            "--height": {
                "type": finite,
                "default": 1.3,
                "help": "above the ground, metres (default 1.3)",
            },
            "--seed": SEED,
        },
    ),
    Command(
        "lidar",
        help="scan a .blend or mesh file of your own with a real instrument",
        description="Scan a Blender scene as it is evaluated, and write a point cloud with labels.",
        epilog="""\
examples:
  python -m headless lidar --list
  python -m headless lidar park.blend --scanner riegl-vz-400i --at 0,0,1.6
  python -m headless lidar park.blend --scanner riegl-vz-400i --at 0,0,1.6 \\
      --azimuth=-30,30 --set angle_step_deg=0.1 --set beam.subrays=37 --out scan.ply
  python -m headless lidar park.blend --scanner riegl-minivux-1uav --along FlightPath
  python -m headless lidar park.blend --scanner riegl-vq-780i --at 0,-200,800 --azimuth 90
  python -m headless lidar --like real.laz --scanner riegl-vux-1uav --out out/like.toml
  python -m headless lidar --survey data/surveys/demo/tls_plane.xml --out plane.laz

--set takes any setting of a scene file's sensor. A scan that was interrupted goes on
with the same command and --resume, to the same bytes.""",
        is_folder=False,
        default=_out_of_lidar,
        least={"seed": 0, "chunk": 1},
        lock=lambda chosen: (
            None if chosen.list else chosen.out.with_name(f".{chosen.out.stem}.lock")
        ),
        kept=_kept_of_lidar,
        options={
            "blend": {
                "type": Path,
                "nargs": "?",
                "metavar": "FILE.blend",
                "help": "the scene: .blend, or glTF (.glb, .gltf), .obj, .ply, .stl, USD",
            },
            "--survey": {
                "type": Path,
                "metavar": "FILE.xml",
                "help": "a survey of HELIOS++ with all it names, in place of a .blend; a file a leg",
            },
            "--assets": {
                "type": Path,
                "metavar": "FOLDER",
                "help": "where paths in the survey start",
            },
            "--reference": {
                "type": Path,
                "metavar": "FILE.json",
                "help": "points and pulses by returns of each leg, to be held beside ours",
            },
            "--echoes": {
                "choices": ("survey", "waveform"),
                "help": "with --survey: echoes as HELIOS++ finds them, by the survey's bins and "
                "window (default), "
                "or of the waveform without bins, as in our own scans",
            },
            "--like": {
                "type": Path,
                "metavar": "REAL.laz",
                "help": "write a scene that is flown as this cloud was; --scanner takes an "
                "instrument's light",
            },
            "--trajectory": {
                "type": Path,
                "metavar": "FILE",
                "help": "with --like: its way, as CSV (time_s, x_m, y_m, z_m, heading_deg, pitch_deg, "
                "roll_deg) or SBET",
            },
            "--trees": {
                "type": Path,
                "metavar": "TABLE",
                "help": "with --like: the trees that stand there, planted as measured on the cloud's ground",
            },
            "--species": {
                "action": "append",
                "default": [],
                "metavar": "NAME=PRESET",
                "help": "with --trees: what to plant for a name of the table, or PRESET alone for all",
            },
            "--list": {"action": "store_true", "help": "print the scanners that are known"},
            "--scanner": {"metavar": "NAME", "help": "a scanner of --list, or a .toml file"},
            "--at": {"metavar": "X,Y,Z", "help": "where it stands, or where a flight starts, m"},
            "--along": {"metavar": "OBJECT", "help": "curve or animated object that it follows"},
            "--azimuth": {
                "metavar": "DEG",
                "help": "FROM,TO of a tripod, heading of a flight; from +X to +Y",
            },
            "--set": {
                "action": "append",
                "default": [],
                "metavar": "KEY=VALUE",
                "help": "any other setting",
            },
            "--seed": {"type": int, "default": 0, "help": "seed of noise and chances (default 0)"},
            "--offset": {
                "metavar": "X,Y,Z",
                "help": "added to coordinates as they are written (UTM), m",
            },
            "--crs": {
                "default": "",
                "metavar": "EPSG:N",
                "help": "their coordinate system, told in LAS files",
            },
            "--out": {"type": Path, "metavar": "FILE", "help": "default out/FILE-NAME.laz"},
            "--format": {"choices": POINT_FORMATS, "help": "default: as --out ends, else laz"},
            "--resume": {"action": "store_true", "help": "go on with an unfinished scan"},
            "--chunk": {"type": int, "metavar": "N", "help": "pulses between two savings"},
            "--engine": {
                "default": "auto",
                "choices": ("auto", "bvhtree", "embree"),
                "help": "who casts rays",
            },
            "--quiet": QUIET,
        },
    ),
    Command(
        "export",
        help="write a scene for HELIOS++ and other programs: OBJ parts, XML, JSON",
        description="Grow a scene and write it for other programs: each mesh once as OBJ, a scene "
        "of HELIOS++, a survey "
        "for each scanner that it can tell, and scene.json with places, labels, sensors, ways and seeds.",
        epilog="""\
examples:
  python -m headless export hedge --out out/hedge-export
  python -m headless lidar --survey out/hedge-export/data/surveys/hedge-tripod.xml

What HELIOS++ cannot say is printed, and stands in scene.json.""",
        default="{}-export",
        whole=True,
        options={
            "scene": SCENE,
            "--out": {
                "type": Path,
                "metavar": "FOLDER",
                "help": "default out/SCENE-export; made if missing",
            },
            "--seed": SEED,
            "--quiet": QUIET,
        },
    ),
    Command(
        "convolve",
        help="hear a dry sound in the forest",
        description="Convolve a dry sound with an impulse response that a reverb wrote. The wet sound has "
        "the response's rate and channels, as 32-bit float.",
        is_folder=False,
        default=_out_of_convolve,
        options={
            "response": {"type": Path, "metavar": "IR.wav", "help": "the impulse response"},
            "dry": {
                "type": sound_file,
                "metavar": "DRY.wav",
                "help": "the dry sound, at any rate, its channels mixed to one, or the name of one of "
                "assets/sounds",
            },
            "--out": {
                "type": Path,
                "metavar": "WET.wav",
                "help": "the wet sound (default IR-DRY.wav beside IR)",
            },
            "--normalise": {
                "type": finite,
                "metavar": "DB",
                "help": "bring the largest sample to so many dB re full scale; left out: levels stay",
            },
        },
    ),
    Command(
        "fly",
        help="fly a policy through a scene's forests",
        description="Fly through forests of a scene by what a LiDAR or two ears tell; write every "
        "way, success against "
        "speed and density, a picture, and a .blend in which the flights are animated.",
        epilog="""\
examples:
  python -m headless fly assets/scenes/flight-poisson.toml --policy gap --episodes 100
  python -m headless fly assets/scenes/flight-poisson.toml --speeds 3,5,8 --densities 0.5,1,2
  python -m headless fly assets/scenes/flight-hedge.toml --policy echo --episodes 20""",
        default="fly-{}",
        whole=True,
        least={"seed": 0, "bags": 0, "episodes": 1},
        options={
            "scene": SCENE,
            "--policy": {"choices": POLICIES, "default": "gap", "help": "default gap"},
            "--episodes": {
                "type": int,
                "default": 100,
                "help": "flights at each speed and density (100)",
            },
            "--speeds": {"metavar": "LIST", "help": "m/s; default: the scene's"},
            "--densities": {"metavar": "LIST", "help": "times the scene's trees (1)"},
            "--trained": {"type": Path, "metavar": "FILE", "help": "what `flight learn` wrote"},
            "--seed": {"type": int, "default": 0, "help": "of the first flight (default 0)"},
            "--no-blend": {"action": "store_true", "help": "write no .blend"},
            "--bags": {
                "type": int,
                "default": 0,
                "metavar": "N",
                "help": "ROS 2 bags of the first N flights",
            },
            "--out": {"type": Path, "metavar": "DIR", "help": "default out/fly-SCENE"},
        },
    ),
    Command(
        "tiles",
        help="scan some tiles of a field, say what all will cost",
        description="Scan some tiles of a scene with [tiles], drawn by chance, and say what the "
        "whole will cost: CPU "
        "hours, bytes and points with their 95 % intervals, and memory of a worker. Nothing is kept.",
        outputs=(),
        least={"workers": 1},
        options={
            "scene": SCENE,
            "--sample": {
                "type": per_cent,
                "default": 0.01,
                "metavar": "P%",
                "help": "share of all tiles that are scanned, at least two (default 1%%)",
            },
            "--seed": SEED,
            "--workers": WORKERS,
            **CLUSTER,
            "--quiet": {"action": "store_true", "help": "say nothing but the result"},
            "--json": {"action": "store_true", "help": "print the result as JSON"},
        },
    ),
    Command(
        "doctor",
        help="say what is installed, what computes, and what is missing",
        description="Print versions and engines, what is missing, and how to get it.",
        outputs=(),
    ),
)
