"""Files a user names: checked before the work begins, written whole or not at all."""

import re

import pytest

from campaign.errors import CampaignError, SpecError
from clearcap.output_files import PLOTS, check_output, replacing


def test_outputs_are_checked(tmp_path):
    """Unknown endings, folders that are not there or not folders: one message with option, path and remedy."""
    check_output("--plot", tmp_path / "a.svg", PLOTS)
    for path, said in (
        (tmp_path / "a.jpg", "unknown ending; allowed: .png, .svg, .pdf"),
        (tmp_path / "a", "unknown ending"),
        (tmp_path / "none" / "a.png", "no folder"),
    ):
        with pytest.raises(SpecError, match=re.escape(said)) as caught:
            check_output("--plot", path, PLOTS)
        assert str(caught.value).startswith(f"--plot {path}: ")
    assert list(tmp_path.iterdir()) == []


def test_picture_that_fails_keeps_the_old_one(tmp_path):
    """An error while drawing: the file that was there as it was, nothing beside it."""
    path = tmp_path / "a.png"
    path.write_bytes(b"old")

    def draw():
        with replacing(path) as temporary:
            assert temporary.suffix == ".png"
            temporary.write_bytes(b"half")
            raise OSError(28, "No space left on device")

    with pytest.raises(CampaignError, match=r"a\.png.*No space left"):
        draw()
    assert [(item.name, item.read_bytes()) for item in tmp_path.iterdir()] == [("a.png", b"old")]
    with replacing(path) as temporary:
        temporary.write_bytes(b"new")
    assert [(item.name, item.read_bytes()) for item in tmp_path.iterdir()] == [("a.png", b"new")]
