"""Write a GIF: in few colours, so that only what changes from frame to frame takes space."""

from typing import Any

import numpy as np
from matplotlib.animation import AbstractMovieWriter
from PIL import Image

COLOURS = 64


class Film(AbstractMovieWriter):
    """A writer of GIFs for matplotlib, as its own but with one palette for all frames."""

    @classmethod
    def isAvailable(cls) -> bool:  # matplotlib's name
        """Say that it needs nothing but Pillow, which matplotlib brings."""
        return True

    def setup(self, fig: Any, outfile: Any, dpi: Any = None) -> None:
        """Begin without frames."""
        super().setup(fig, outfile, dpi)  # type: ignore[no-untyped-call]
        self._frames: list[Image.Image] = []

    def grab_frame(self, **_: Any) -> None:
        """Add the figure as it is."""
        canvas: Any = self.fig.canvas
        canvas.draw()
        self._frames.append(Image.fromarray(np.asarray(canvas.buffer_rgba())[:, :, :3]))

    def finish(self) -> None:
        """Write the frames in the colours of the one in their middle; equal ones become one that stays longer."""
        cover = Image.Quantize.MAXCOVERAGE  # keeps the hue of a thin arrow
        palette = self._frames[len(self._frames) // 2].quantize(COLOURS, method=cover)
        frames = [frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in self._frames]
        duration = round(1000 / self.fps)
        frames[0].save(self.outfile, save_all=True, append_images=frames[1:], duration=duration, loop=0)
