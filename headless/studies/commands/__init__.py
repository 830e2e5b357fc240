"""The commands of the studies, a file each: they come with the repository, not with the extension."""

from .bench import BenchCommand
from .flight import FlightCommand
from .reverb_figures import ReverbFiguresCommand
from .simlidar import SimlidarCommand
from .study import StudyCommand
from .validate import ValidateCommand

COMMANDS = (
    *(ValidateCommand(), BenchCommand(), StudyCommand()),
    *(SimlidarCommand(), ReverbFiguresCommand(), FlightCommand()),
)
