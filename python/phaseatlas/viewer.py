"""Surfaces, segmentations and atlases in a viewer of their own, by viser."""

from __future__ import annotations

import base64
from typing import TYPE_CHECKING, Any

import numpy as np

from .arrays import Bytes
from .page.drawing import Drawing, drawing
from .page.looks import looks, measured
from .page.subject import subject

if TYPE_CHECKING:
    import viser

__all__ = ["show"]

_GREY = 200


def show(thing: object, *, port: int = 8080) -> viser.ViserServer:
    """Show a surface, a segmentation, a tree or an atlas in the browser.

    It has the looks of `Atlas.save("x.html")` but pictures. It is there as long as the process
    runs; in a script, call `sleep_forever` of what is returned.

    Parameters
    ----------
    thing : Surface, Scene, Segmentation, SegmentTree, Atlas or Unwrapped
        What to show.
    port : int, default 8080
        Where the page is: http://localhost:8080.

    Returns
    -------
    viser.ViserServer
        The server, whose scene can be added to.

    Raises
    ------
    ImportError
        Without the extra `view`.
    """
    try:
        import viser
    except ImportError as error:
        raise ImportError("show needs the package viser: pip install 'phaseatlas[view]'") from error
    import trimesh

    shown = subject(thing)
    plain = np.zeros(shown.surface.n_faces, dtype=np.int64)
    drawn = drawing(shown.surface, shown.chart, plain)
    # By the names of the buttons of a page.
    found = {
        look["label"]: _colours(look, drawn)
        for look in looks(shown, drawn, measured(shown))
        if look["kind"] not in ("picture", "checker")
    }
    server = viser.ViserServer(port=port)
    server.scene.set_up_direction("+y")

    def draw(name: str) -> None:
        mesh = trimesh.Trimesh(
            drawn.positions,
            drawn.faces,
            vertex_normals=drawn.normals,
            vertex_colors=found[name],
            process=False,
        )
        server.scene.add_mesh_trimesh("/surface", mesh)

    choice = server.gui.add_dropdown("Shown", tuple(found))
    choice.on_update(lambda _: draw(choice.value))
    draw(choice.value)
    return server


def _colours(look: dict[str, Any], drawn: Drawing) -> Bytes:
    """Colours of the drawn vertices, (k, 3)."""

    def read(name: str) -> Bytes:
        return np.frombuffer(base64.b64decode(look[name]), dtype=np.uint8)

    if look["kind"] == "charts":
        return read("colours").reshape(-1, 3)[drawn.chart[drawn.kept]]
    if look["kind"] == "scale":
        return read("map").reshape(-1, 3)[read("values")]
    if look["kind"] == "colours":
        return read("colours").reshape(-1, 3)
    return np.full((len(drawn.kept), 3), _GREY, dtype=np.uint8)
