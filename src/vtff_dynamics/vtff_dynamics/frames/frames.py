"""Names of the modules of frames, until every caller imports those."""

from vtff_dynamics.frames.earth import *  # noqa: F403
from vtff_dynamics.frames.geodetic import *  # noqa: F403
from vtff_dynamics.frames.rtn import *  # noqa: F403
from vtff_dynamics.time.local_time import *  # noqa: F403
