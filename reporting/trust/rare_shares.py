"""Lines of the trust card on rare rejects: whether their shares are known, and whether the weights are correct."""

from reporting import format_numbers
from reporting.rare.plain_check import CHECK_BAR
from reporting.rare.rare_rejects import RareRejects
from reporting.trust.check import Check

LOOSE = 0.2  # of a share: a larger allowance for regions without an aimed component gives a warning


def rare_checks(rare: RareRejects | None) -> tuple[Check, ...]:
    """Return the lines for an importance-sampling campaign; empty for other campaigns."""
    return () if rare is None else (_known(rare), _agrees(rare))


def _known(rare: RareRejects) -> Check:
    """Check that the share of every response is supported by its weights."""
    name, shares = "Rare rejects", {r.response: r.total for r in rare.responses}
    if not shares:
        return Check(name, "info", "No response has limits.")
    doubts = [f"{response}: {share.doubt}" for response, share in shares.items() if share.doubt]
    if doubts:
        text = f"Only an upper bound is known for {'; '.join(doubts)}. clearcap design uses these runs to aim better."
        return Check(name, "attention", text, float(len(doubts)))
    loose = [
        f"{response} up to {format_numbers.ppm(share.by_chance_ppm)} ppm"
        for response, share in shares.items()
        if share.rejects and share.by_chance_ppm > LOOSE * share.ppm
    ]
    if loose:
        text = (
            f"Regions at which no component aims may hold further rejects: {', '.join(loose)}, which the upper ends of"
            " the intervals include. More runs of a component of scale 2 narrow this; if rejects were found there,"
            " clearcap design aims at them."
        )
        return Check(name, "attention", text, float(len(loose)))
    found = {response: share.standard_error for response, share in shares.items() if share.standard_error is not None}
    none = [response for response in shares if response not in found]
    text = f"Weighted over {format_numbers.grouped(rare.runs)} runs."
    if found:
        widest = max(found, key=found.__getitem__)
        error = format_numbers.percent(found[widest])
        text += f" Shares are known to a standard error of {error} or better (widest: {widest})."
    if none:
        text += f" No reject of {', '.join(none)} was found: below {format_numbers.ppm(rare.unseen_ppm)} ppm."
    return Check(name, "good", text)


def _agrees(rare: RareRejects) -> Check:
    """Check weighted shares against counted shares, and the mean weight against 1."""
    errors = {f"{check.response} {check.side} {check.at:.6g}": abs(check.errors) for check in rare.checks}
    errors["the mean weight and 1"] = abs(rare.mean_weight_errors)
    worst = max(errors, key=errors.__getitem__)
    distance = format_numbers.fixed(errors[worst], 1, (CHECK_BAR,))
    text = (
        f"Weighted shares differ from those counted in the {format_numbers.grouped(rare.plain)} plain runs by at most"
        f" {distance} standard errors, at {len(rare.checks)} limits moved in until both have rejects (largest: {worst})"
    )
    if errors[worst] <= CHECK_BAR:
        return Check("Weights", "good", f"{text}.", errors[worst])
    return Check("Weights", "bad", f"{text}: the weights do not fit the runs.", errors[worst])
