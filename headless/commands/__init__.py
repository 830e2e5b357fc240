"""The commands of ``python -m headless``, a file each, in the order of its help."""

from .accuracy import AccuracyCommand
from .allometry import AllometryCommand
from .assets import AssetsCommand
from .canopy import CanopyCommand
from .convolve import ConvolveCommand
from .dataset import DatasetCommand
from .demo import DemoCommand
from .derive import DeriveCommand
from .doctor import DoctorCommand
from .estimate import EstimateCommand
from .export import ExportCommand
from .fly import FlyCommand
from .lidar import LidarCommand
from .run import RunCommand
from .species import SpeciesCommand
from .stand import StandCommand
from .template import TemplateCommand
from .tiles import TilesCommand

COMMANDS = (
    *(RunCommand(), DemoCommand(), DatasetCommand(), AccuracyCommand()),
    *(DeriveCommand(), TemplateCommand(), SpeciesCommand(), StandCommand(), EstimateCommand()),
    *(AllometryCommand(), AssetsCommand(), CanopyCommand()),
    *(LidarCommand(), ExportCommand(), ConvolveCommand(), FlyCommand()),
    *(TilesCommand(), DoctorCommand()),
)
