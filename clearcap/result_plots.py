"""The figures of a response on matplotlib's axes: those of its page in the report, from the same numbers."""

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from scipy.special import ndtr

from campaign.errors import SpecError
from clearcap.pictures.style import PALETTE
from engine.mechanism.faults import did_you_mean
from reporting.analysis import Analysis
from reporting.render.figures import PROBABILITIES, density_bars, tick_scores
from reporting.render.panels import deciding_fit
from reporting.render.svg import BAR, DEEP, LIMIT, MUTED, axis_name, density_name
from reporting.response import ResponseAnalysis
from reporting.shape.fitting import distribution

if TYPE_CHECKING:
    from matplotlib.axes import Axes


class Plots:
    """The figures of a response, such as ``results.plot.histogram("FC-1")``.

    Each is drawn on the ``axes`` given, or on matplotlib's current ones, and returns them. Raises SpecError for a
    response that is not there, CampaignError if no row is computed.
    """

    def __init__(self, analysis: Callable[[], Analysis]) -> None:
        self._analysis = analysis

    def histogram(self, response: str, axes: "Axes | None" = None) -> "Axes":
        """Draw the distribution with its limits, and the density of the family that decides the verdict."""
        found, drawn = self._response(response), _axes(axes)
        bins, c, spec = found.histogram, found.capability, found.spec
        if bins is not None:
            edges, heights = density_bars(bins)
            drawn.stairs(heights, edges, fill=True, color=BAR)
        if c.mean is not None and c.std:
            x = np.linspace(c.mean - 4.5 * c.std, c.mean + 4.5 * c.std, 241)
            z = (x - c.mean) / c.std
            density = np.exp(-(z**2) / 2) / (c.std * np.sqrt(2 * np.pi))
            if fit := deciding_fit(found):
                with np.errstate(all="ignore"):
                    density = np.exp(distribution(fit).logpdf(x))
            drawn.plot(x, np.where(np.isfinite(density), density, np.nan), color=DEEP)
        _limits(drawn, found)
        drawn.set(xlabel=axis_name(spec.name, spec.unit), ylabel=density_name(spec.unit))
        return drawn

    def probability(self, response: str, axes: "Axes | None" = None) -> "Axes":
        """Draw the values against normal scores, with the family that decides; a normal response is a straight line."""
        found, drawn = self._response(response), _axes(axes)
        plot, c, spec = found.plot, found.capability, found.spec
        if plot is not None and c.mean is not None and c.std:
            reach = max(3.1, float(np.max(np.abs(plot.scores))) + 0.2)
            z = np.linspace(-reach, reach, 161)
            drawn.plot(plot.values, plot.scores, ".", color=DEEP, markersize=4)
            drawn.plot(c.mean + z * c.std, z, color=MUTED, linestyle=":")
            if fit := deciding_fit(found):
                with np.errstate(all="ignore"):
                    drawn.plot(distribution(fit).ppf(ndtr(z)), z, color=PALETTE[3])
            else:
                drawn.fill_betweenx(plot.scores, plot.low, plot.high, color=MUTED, alpha=0.15)
            ticks = tick_scores(PROBABILITIES, reach)
            drawn.set_yticks([score for score, _ in ticks], [words for _, words in ticks])
        _limits(drawn, found)
        drawn.set(xlabel=axis_name(spec.name, spec.unit), ylabel="values below [%]")
        return drawn

    def causes(self, response: str, axes: "Axes | None" = None) -> "Axes":
        """Draw the share of the variance that each variable causes, the largest on top."""
        found, drawn = self._response(response), _axes(axes)
        ranked = found.sensitivity.ranked if found.sensitivity else ()
        shown = [(each.variable, 100 * each.share) for each in ranked if each.share is not None]
        drawn.barh([name for name, _ in shown], [share for _, share in shown], color=BAR)
        drawn.invert_yaxis()
        drawn.set(xlabel=f"share of the variance of {found.spec.name} [%]")
        return drawn

    def convergence(self, response: str, axes: "Axes | None" = None) -> "Axes":
        """Draw the index over the first n samples, with its interval at 95 %."""
        found, drawn = self._response(response), _axes(axes)
        run, spec = found.running, found.spec
        if run is not None:
            drawn.fill_between(run.n, run.low, run.high, color=BAR, alpha=0.4)
            drawn.plot(run.n, run.value, color=DEEP)
            drawn.set(xscale="log", ylabel=run.index if run.index != "mean" else axis_name(spec.name, spec.unit))
            if run.index != "mean":
                drawn.axhline(spec.requirement, color=LIMIT, linestyle="--")
        drawn.set(xlabel="samples")
        return drawn

    def _response(self, name: str) -> ResponseAnalysis:
        known = {each.spec.name: each for each in self._analysis().responses}
        if name not in known:
            raise SpecError(f"no response {name!r:.80}; allowed: {', '.join(known)}{did_you_mean(name, known)}")
        return known[name]


def _axes(axes: "Axes | None") -> "Axes":
    if axes is not None:
        return axes
    from matplotlib import pyplot

    return pyplot.gca()


def _limits(axes: "Axes", response: ResponseAnalysis) -> None:
    for limit, name in ((response.spec.lsl, "LSL"), (response.spec.usl, "USL")):
        if limit is not None:
            axes.axvline(limit, color=LIMIT, linestyle="--")
            axes.annotate(
                f"{name} {limit:g}", (limit, 1.0), xycoords=("data", "axes fraction"), ha="center", va="bottom",
                color=LIMIT,
            )  # fmt: skip
