"""Put the overlapping charts of a surface into the page that blends them live.

``python examples/blend.py`` writes the charts of a starfish into ``examples/blend.html``, and
``python examples/blend.py page.html --charts charts.glb`` those of a file that
``phaseatlas atlas model.obj -o out.obj --levels 3 --charts charts.glb`` wrote into a new page. The
page needs no network: open it in any browser. ``docs/blending.md`` explains its shaders.
"""

import argparse
import base64
import re
from pathlib import Path
from tempfile import TemporaryDirectory

import phaseatlas as pa

PAGE = Path(__file__).with_suffix(".html")
_DATA = re.compile(r'(<script id="data" type="text/plain">)[^<]*(</script>)')


def starfish_charts() -> bytes:
    """The file of the charts of eight segments of equal area."""
    atlas = pa.build_atlas(pa.segment(pa.datasets.starfish(3), 3))
    with TemporaryDirectory() as folder:
        path = Path(folder, "charts.glb")
        atlas.save_charts(path)
        return path.read_bytes()


parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
parser.add_argument("page", nargs="?", type=Path, default=PAGE, help="where the page is written")
parser.add_argument("--charts", type=Path, help="a file of --charts; a starfish by default")
arguments = parser.parse_args()

data = arguments.charts.read_bytes() if arguments.charts else starfish_charts()
text = base64.b64encode(data).decode()
page = _DATA.sub(lambda match: match[1] + text + match[2], PAGE.read_text(encoding="utf-8"))
arguments.page.write_text(page, encoding="utf-8")
print(f"wrote {arguments.page}")
