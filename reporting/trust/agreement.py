"""Lines of the trust card on the agreement of estimates, and on the joint confidence of many statements."""

from scipy.special import ndtri

from reporting import format_numbers
from reporting.capability.verdict import class_of
from reporting.response import ResponseAnalysis
from reporting.trust.check import Check


def verdicts_hold(responses: tuple[ResponseAnalysis, ...]) -> Check:
    """Check that every verdict is certain, and quote the evidence against those that are not."""
    judged = [r for r in responses if r.verdict.certain is not None]
    if not judged:
        return Check("Verdicts", "info", "No response has a verdict.")
    doubtful = [r for r in judged if r.verdict.reasons]
    if not doubtful:
        return Check("Verdicts", "good", "Cpk, count of rejects and all other estimates agree on every verdict.", 0.0)
    alike: dict[str, list[str]] = {}
    for r in doubtful:
        alike.setdefault(f"({_in_words(r)}): {' '.join(r.verdict.reasons)}", []).append(r.spec.name)
    text = " ".join(f"{', '.join(names)} {words}" for words, names in alike.items())
    return Check("Verdicts", "attention", text, float(len(doubtful)))


def many_statements(responses: tuple[ResponseAnalysis, ...], confidence: float) -> Check:
    """State how many of the page's intervals may be wrong by chance, and which verdicts hold jointly."""
    certain = [r for r in responses if r.verdict.certain]
    shares = sum(
        influence.first_order_interval is not None
        for r in responses
        if r.sensitivity
        for influence in r.sensitivity.influences
    )
    judged = [r for r in responses if r.verdict.certain is not None]
    count = len(judged) + shares
    level = f"{format_numbers.plain(round(100 * confidence, 1))} %"
    if count < 2:
        return Check("All at once", "info", f"Each interval contains the true value in {level} of campaigns.")
    missing = format_numbers.plain(round(count * (1 - confidence), 1))
    text = (
        f"{_counted(len(judged), 'verdict')} and {_counted(shares, 'share')} of variables are each stated at {level} "
        f"confidence on their own, so about {missing} of these {count} may be wrong by chance."
    )
    if len(certain) > 1:
        together = [r.spec.name for r in certain if _certain_among(r, len(judged), confidence)]
        names = "all certain ones" if len(together) == len(certain) else ", ".join(together) or "none"
        text += f" Verdicts that hold at {level} all at once (Bonferroni): {names}."
    return Check("All at once", "info", text, count * (1 - confidence))


def _counted(count: int, what: str) -> str:
    """Return a number of things in words."""
    return f"{count} {what}{'' if count == 1 else 's'}"


def _certain_among(response: ResponseAnalysis, judged: int, confidence: float) -> bool:
    """Return whether the interval of Cpk stays in one class if it is widened to hold for all verdicts jointly."""
    c = response.capability
    if c.cpk is None or c.cpk_interval is None:
        return False
    # Each of the verdicts may fail only with its part of the error (Bonferroni); the half width of an interval of Cpk
    # grows with the normal quantile.
    wider = float(ndtri(1 - (1 - confidence) / (2 * judged)) / ndtri(0.5 + confidence / 2))
    return len({class_of(c.cpk + wider * (end - c.cpk)) for end in c.cpk_interval}) == 1


def _in_words(response: ResponseAnalysis) -> str:
    """Return the verdict on a response in words."""
    return response.verdict.word + ("" if response.verdict.certain else ", not certain")
