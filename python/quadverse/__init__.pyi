from ._quadverse import Snapshot as Snapshot, VelocityTask as VelocityTask, __version__ as __version__
from .batch import Batch as Batch, Parameters as Parameters
from .gym import VelocityEnv as VelocityEnv
from .recording import Recording as Recording, open as open
from .report import Replay as Replay, Report as Report, diagnose as diagnose, replay as replay
