"""What figures mean, in a line each; nothing is imported for it."""

__all__ = ["METRICS", "SEGMENTS", "SURFACE"]

# What `Atlas.metrics` returns, in a line each.
METRICS = {
    "charts": "number of charts",
    "non_disk": "charts that are no disk",
    "seam": "length of the seams over the square root of the area",
    "yamabe": "distortion that the shapes of the charts force on a conformal map; 0 is flat",
    "qc": "mean of the ratio of stretches; 1 keeps angles",
    "hencky": "variance of the log scale; 0 keeps relative areas",
    "l2": "root mean square stretch (Sander et al. 2001); 1 keeps lengths",
    "degenerate": "faces without area in the plane",
    "flips": "faces that are turned over in the plane",
    "crossing": "charts whose boundary crosses itself",
    "overlap": "texels that are covered twice, percent",
    "packing": "area of the charts, percent of the square",
}

# What pages tell of segments, and of surfaces.
SEGMENTS = {
    "segments": "number of segments",
    "levels": "depth of the binary tree",
    "largest": "area of the largest segment, percent of the surface",
    "smallest": "area of the smallest segment, percent of the surface",
    "in pieces": "segments that do not hang together",
    "length": "length of the edges between segments over the square root of the area",
}
SURFACE = {
    "vertices": "points of the mesh",
    "faces": "triangles of the mesh",
    "pieces": "parts that do not touch",
    "genus": "number of handles",
    "boundary loops": "closed curves that bound the surface",
    "area": "in the units of the mesh, squared",
}
