"""A track between two anchors, found again in the images."""

from planewright.mending.gap import Gap as Gap
from planewright.mending.gap import blend as blend
from planewright.mending.mend import Mended as Mended
from planewright.mending.mend import MendOptions as MendOptions
from planewright.mending.mend import mend as mend
from planewright.mending.trace import TraceOptions as TraceOptions
from planewright.mending.trace import trace as trace
