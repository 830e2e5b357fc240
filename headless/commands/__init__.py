"""The commands of ``python -m headless``, a file each, in the order of its help."""

from .accuracy import Accuracy
from .allometry import Allometry
from .assets import Assets
from .bench import Bench
from .canopy import Canopy
from .convolve import Convolve
from .dataset import Dataset
from .demo import Demo
from .derive import Derive
from .estimate import Estimate
from .flight import Flight
from .fly import Fly
from .lidar import Lidar
from .reverb_figures import ReverbFigures
from .run import Run
from .simlidar import Simlidar
from .species import Species
from .stand import Stand
from .template import Template
from .validate import Validate

COMMANDS = (
    *(Run(), Demo(), Dataset(), Accuracy(), Validate(), Bench()),
    *(Derive(), Template(), Species(), Stand(), Estimate(), Allometry(), Assets(), Canopy()),
    *(Lidar(), Simlidar(), Convolve(), ReverbFigures()),
    *(Fly(), Flight()),
)
