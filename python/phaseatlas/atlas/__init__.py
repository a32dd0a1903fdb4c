"""The paper, section 4: from a segmentation to overlapping charts that blend."""

from .atlas import Atlas, build_atlas
from .charts import Chart

__all__ = ["Atlas", "Chart", "build_atlas"]
