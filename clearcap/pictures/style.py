"""The style of pictures: colours that colour-blind readers can tell apart, always with a second distinction."""

import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.axes import Axes

INK, MUTED, GRID = "#1d2733", "#5a6675", "#dfe4ea"
FORCE = "#a61c00"
PALETTE = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#B07A00", "#56B4E9", "#6A3D9A")  # after Okabe and Ito
DASHES = ("-", "--", "-.", ":")
MARKERS = ("o", "s", "^", "D", "v", "P")

STYLE: Any = {
    "svg.fonttype": "none",
    "svg.hashsalt": "clearcap",  # otherwise ids are random, and the same run would not give the same bytes
    "text.parse_math": False,  # a response may be called "F$1"
    "font.family": "sans-serif",
    "font.size": 9.0,
    "axes.edgecolor": MUTED,
    "axes.labelcolor": INK,
    "axes.titlesize": 9.0,
    "axes.titlelocation": "left",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.axisbelow": True,
    "xtick.color": MUTED,
    "ytick.color": MUTED,
    "text.color": INK,
    "lines.linewidth": 1.3,
}


@contextmanager
def styled(**more: Any) -> Iterator[None]:
    """Draw in this style during the block, with further settings, and otherwise with matplotlib's defaults.

    A file ``matplotlibrc`` in the current folder is ignored, because anybody may have put it there, and it could even
    name the program that writes animations. Warnings about letters that matplotlib's fonts lack are suppressed: in SVG
    the reader's browser draws all text, and in a GIF a box takes the place of each.
    """
    import matplotlib

    settings: Any = {**STYLE, **more}
    with matplotlib.rc_context(), warnings.catch_warnings():
        warnings.filterwarnings("ignore", r"Glyph .* missing from (current )?font", UserWarning)
        matplotlib.rcdefaults()
        matplotlib.rcParams.update(settings)
        yield


def label_with_unit(name: str, unit: str) -> str:
    """Return the label of an axis: a name with its unit, if it has one."""
    return name if unit in ("", "1") else f"{name} [{unit}]"


def hide_axes(axes: "Axes") -> None:
    """Remove frame, ticks and background of axes that show bodies instead of a graph."""
    axes.set_axis_off()
    axes.set_aspect("equal")


def file_metadata(suffix: str, text: str) -> dict[str, Any]:
    """Return the metadata of a file: a description, and no date, so that the same run gives the same bytes."""
    dateless = {".pdf": {"Subject": text, "CreationDate": None}, ".svg": {"Description": text, "Date": None}}
    return {"Title": "clearcap simulate", **dateless.get(suffix, {"Description": text})}


def as_bytes(kind: str, draw: Callable[[Path], None]) -> bytes:
    """Return the content of a picture, ``svg``, ``png`` or ``gif``, that a function draws into a file."""
    with TemporaryDirectory(prefix="clearcap-") as folder:
        picture = Path(folder, f"picture.{kind}")
        draw(picture)
        return picture.read_bytes()
