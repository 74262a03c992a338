"""Small patches of the whole image, followed through the clip."""

from planewright.features.detect import DetectOptions as DetectOptions
from planewright.features.features import Features as Features
from planewright.features.follow import FollowOptions as FollowOptions
from planewright.features.follow import follow_features as follow_features
