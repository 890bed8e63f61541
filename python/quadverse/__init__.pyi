from ._quadverse import (
    NavigationTask as NavigationTask,
    Snapshot as Snapshot,
    VelocityTask as VelocityTask,
    __version__ as __version__,
)
from .batch import Batch as Batch, Parameters as Parameters
from .command import (
    Contact as Contact,
    Policy as Policy,
    QvError as QvError,
    Tuned as Tuned,
    contact as contact,
    qv as qv,
    train_walk as train_walk,
    tune as tune,
)
from .gym import NavigationEnv as NavigationEnv, VelocityEnv as VelocityEnv
from .view import Cloud as Cloud, cloud as cloud, open_cloud as open_cloud, render as render
from .recording import Recording as Recording, open as open
from .report import Replay as Replay, Report as Report, diagnose as diagnose, replay as replay
from . import fleet as fleet
