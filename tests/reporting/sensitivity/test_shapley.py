"""The Shapley value against games whose shares are known."""

import numpy as np
import pytest

from reporting.sensitivity.regression import shapley_values


def test_the_glove_game():
    """Player 0 owns a left glove, players 1 and 2 a right one each: 2/3, 1/6, 1/6."""
    worth = np.array([float(s & 1 and s > 1) for s in range(8)])
    assert shapley_values(worth) == pytest.approx([2 / 3, 1 / 6, 1 / 6])


def test_an_additive_game_gives_each_player_its_own():
    """Several games at once; the shares add up to the worth of all."""
    own = np.random.default_rng(1).normal(size=(5, 3))
    worth = np.array([sum((own[i] for i in range(5) if s >> i & 1), np.zeros(3)) for s in range(32)])
    assert shapley_values(worth) == pytest.approx(own)
