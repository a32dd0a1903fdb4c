"""Charts by energy: the sharp labels of a surface that cost least in seam, cuts and distortion."""

from .partition import Partition, Phase, check_options, partition

__all__ = ["Partition", "Phase", "check_options", "partition"]
