"""Line of the trust card on the inputs: whether they were drawn as requested."""

from reporting import format_numbers
from reporting.inputs import CorrelationAnalysis, VariableAnalysis
from reporting.trust.check import Check

# A drawn mean, sigma or correlation does not deviate by more standard errors from the requested one by chance.
INPUT_ERRORS_BAR = 4.0
# A distribution does not have a smaller p-value by chance, even in many campaigns with many variables.
INPUT_P_BAR = 1e-5


def drawn_as_requested(
    variables: tuple[VariableAnalysis, ...], correlations: tuple[CorrelationAnalysis, ...], *, production: bool
) -> Check:
    """Check mean, sigma, bounds, distribution and correlations of the drawn variables against the request."""
    name = "Inputs as requested"
    if not variables:
        return Check(name, "info", "The campaign has no variable.")
    outside = sum(v.outside for v in variables)
    if outside:
        text = f"{format_numbers.grouped(outside)} drawn values are outside the requested bounds or missing."
        return Check(name, "bad", text, float(outside))
    moments = [(v.spec.name, (("mean", v.mean_errors), ("sigma", v.std_errors))) for v in variables]
    errors = {f"{word} of {v}": e for v, pairs in moments for word, e in pairs if e is not None}
    errors |= {f"correlation of {c.first} and {c.second}": abs(c.errors) for c in correlations}
    if not errors or not production:
        reason = (
            "there are too few samples"
            if production
            else "the samples do not represent production, so there is no reason"
        )
        return Check(
            name, "info", f"All values are within their bounds; {reason} to compare the distributions with the request."
        )
    worst = max(errors, key=errors.__getitem__)
    different = [v.spec.name for v in variables if v.p_value is not None and v.p_value < INPUT_P_BAR]
    distance = format_numbers.fixed(errors[worst], 1, (INPUT_ERRORS_BAR,))
    text = (
        f"Means, sigmas and correlations are within {distance} standard errors of the request (largest: {worst}); "
        "no value is outside its bounds."
    )
    if different:
        text += f" The distribution of {', '.join(different)} is not the requested one (Kolmogorov)."
    return Check(name, "attention" if different or errors[worst] > INPUT_ERRORS_BAR else "good", text, errors[worst])
