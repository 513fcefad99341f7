"""The palette of a GIF."""

import numpy as np
from PIL import Image

from clearcap.pictures.animation import palette_of


def test_palette_keeps_areas_and_thin_things():
    """Colours of areas come out exactly, the hue of a few pixels nearly, among as many shades as there are pixels."""
    picture = np.full((100, 100, 3), 255, np.uint8)
    picture[:50] = (244, 246, 249)
    picture[60:80] = np.arange(20 * 100 * 3).reshape(20, 100, 3) % 251
    picture[90, 40:60] = (166, 28, 0)
    frame = Image.fromarray(picture)
    drawn = np.asarray(frame.quantize(palette=palette_of(frame), dither=Image.Dither.NONE).convert("RGB"), int)
    np.testing.assert_array_equal(drawn[:50], picture[:50])
    np.testing.assert_array_equal(drawn[95], picture[95])
    assert np.abs(drawn[90, 50] - [166, 28, 0]).max() < 30
