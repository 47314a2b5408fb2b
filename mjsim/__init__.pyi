"""What a type checker sees of mjsim; the names are loaded when they are first used."""

from mjsim.animation.ladder import animate_ladder as animate_ladder
from mjsim.animation.movie import animate as animate
from mjsim.batch.fleet import fleet as run_fleet
from mjsim.batch.run import batch as run_batch
from mjsim.campaign.files import read_campaign as read_campaign
from mjsim.campaign.machine_file import read_machine as read_machine
from mjsim.campaign.machine_file import write_machine as write_machine
from mjsim.campaign.new import new_campaign as new_campaign
from mjsim.commands.calibrate import calibrate as calibrate
from mjsim.commands.check import check as check
from mjsim.commands.check import write_corrected as write_corrected
from mjsim.commands.compare import compare as compare
from mjsim.commands.diagnose import diagnose as diagnose
from mjsim.commands.edit import add as add
from mjsim.commands.edit import remove as remove
from mjsim.commands.explain import explain as explain
from mjsim.commands.export import export as export
from mjsim.commands.geometry import geometry as geometry
from mjsim.commands.history import read_history as history
from mjsim.commands.plan import plan as plan
from mjsim.compensation.compensate import compensate as compensate
from mjsim.compensation.compensate import write_compensation as write_compensation
from mjsim.compensation.controls import Settings as ControlSettings
from mjsim.effects.registry import kinds as list_effects
from mjsim.effects.registry import make as make_effect
from mjsim.effects.registry import register as register
from mjsim.errors import InputError as InputError
from mjsim.errors import SimulationError as SimulationError
from mjsim.importing.features import import_features as import_features
from mjsim.importing.features import imported_features as imported_features
from mjsim.importing.importer import import_trace as import_trace
from mjsim.importing.logs import import_log as import_log
from mjsim.inference.pitch.identify import identify_pitch_errors as identify_pitch_errors
from mjsim.instruments.ball_bar.program import driven_by as driven_by
from mjsim.linuxcnc.configuration import Settings as LinuxCNCSettings
from mjsim.linuxcnc.run import run_test as run_on_linuxcnc
from mjsim.machine.effect import Effect as Effect
from mjsim.machine.effect import Parameter as Parameter
from mjsim.machine.effect import Remedy as Remedy
from mjsim.machine.effect import SearchHints as SearchHints
from mjsim.machine.plant import Motion as Motion
from mjsim.nc.control import Control as Control
from mjsim.nc.control import feed_report as feed_report
from mjsim.nc.read import read_nc as read_nc
from mjsim.nc.write import Options as NCOptions
from mjsim.nc.write import write_nc as write_nc
from mjsim.paper.figures import figures as figures
from mjsim.prediction.parts import part as part
from mjsim.prediction.predict import predict as predict
from mjsim.report.certificate import make_certificate as make_certificate
from mjsim.report.write import report as make_report
from mjsim.simulation.multibody import simulate as simulate
from mjsim.workbench.state import workbench as open_workbench

__version__: str
__all__ = [
    "Control",
    "ControlSettings",
    "Effect",
    "InputError",
    "LinuxCNCSettings",
    "Motion",
    "NCOptions",
    "Parameter",
    "Remedy",
    "SearchHints",
    "SimulationError",
    "__version__",
    "add",
    "animate",
    "animate_ladder",
    "calibrate",
    "check",
    "compare",
    "compensate",
    "diagnose",
    "driven_by",
    "explain",
    "export",
    "feed_report",
    "figures",
    "geometry",
    "history",
    "identify_pitch_errors",
    "import_features",
    "import_log",
    "import_trace",
    "imported_features",
    "list_effects",
    "make_certificate",
    "make_effect",
    "make_report",
    "new_campaign",
    "open_workbench",
    "part",
    "plan",
    "predict",
    "read_campaign",
    "read_machine",
    "read_nc",
    "register",
    "remove",
    "run_batch",
    "run_fleet",
    "run_on_linuxcnc",
    "simulate",
    "write_compensation",
    "write_corrected",
    "write_machine",
    "write_nc",
]
