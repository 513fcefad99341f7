"""Write a GIF in few colours, so that only changes from frame to frame take space."""

from typing import Any

import numpy as np
from matplotlib.animation import AbstractMovieWriter
from PIL import Image

AREAS, OTHERS = 16, 32  # number of colours for large areas, and for all else
CLOSE = 8  # of 256 in each channel; closer colours count as one


class GifWriter(AbstractMovieWriter):
    """A writer of GIFs for matplotlib, like matplotlib's own but with one palette for all frames."""

    @classmethod
    def isAvailable(cls) -> bool:  # matplotlib's name
        """Return True: only Pillow is needed, which matplotlib depends on."""
        return True

    def setup(self, fig: Any, outfile: Any, dpi: Any = None) -> None:
        """Start without frames."""
        super().setup(fig, outfile, dpi)  # type: ignore[no-untyped-call]
        self._frames: list[Image.Image] = []
        self._held = 0

    def grab_frame(self, **_: Any) -> None:
        """Add the current figure as a frame."""
        canvas: Any = self.fig.canvas
        canvas.draw()
        self._frames.append(Image.fromarray(np.asarray(canvas.buffer_rgba())[:, :, :3]))

    def hold(self, frames: int) -> None:
        """Show the last frame for the time of ``frames`` further ones, without drawing it again."""
        self._held = frames

    def finish(self) -> None:
        """Write the frames in the colours of the middle one; the last frame is shown for the time of held frames."""
        palette = palette_of(self._frames[min((len(self._frames) + self._held) // 2, len(self._frames) - 1)])
        frames = [frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in self._frames]
        each = round(1000 / self.fps)
        durations = [each] * (len(frames) - 1) + [each * (1 + self._held)]
        frames[0].save(self.outfile, save_all=True, append_images=frames[1:], duration=durations, loop=0)


def palette_of(frame: Image.Image) -> Image.Image:
    """Return an image with a palette for frames like this one.

    The palette holds the exact colours of large areas, and other colours that differ clearly from these.
    """
    red, green, blue = np.moveaxis(np.asarray(frame, np.uint32), -1, 0)
    packed, count = np.unique(red << 16 | green << 8 | blue, return_counts=True)  # sorting numbers is faster
    colours = np.stack([packed >> 16, packed >> 8 & 255, packed & 255], axis=1)
    covering = frame.quantize(OTHERS, method=Image.Quantize.MAXCOVERAGE)  # keeps the hue of a thin arrow
    others = np.reshape(covering.getpalette() or [], (-1, 3))
    chosen = np.empty((0, 3), int)
    for colour in [*colours[np.argsort(-count)[:AREAS]].astype(int), *others]:
        if (np.abs(chosen - colour).max(axis=1) > CLOSE).all():  # Pillow would confuse closer colours
            chosen = np.vstack([chosen, colour])
    palette = Image.new("P", (1, 1))
    palette.putpalette(chosen.ravel().tolist())
    return palette
