"""The drawing of a campaign's mechanism for its report."""

import logging

from campaign.pictures.sketches.sketch import sketch_mechanism
from campaign.plan import Plan
from reporting.spec import DrawnLine, DrawnWords, LegendEntry, MechanismDrawing

logger = logging.getLogger(__name__)


def mechanism_drawing(plan: Plan) -> tuple[MechanismDrawing | None, str]:
    """Return the drawing of a campaign's mechanism, or None and the reason why there is none.

    If drawing fails for any reason, the report is written without the drawing.
    """
    try:
        sketch = sketch_mechanism(plan.mechanism)
    except Exception as error:  # anything: a mechanism from an earlier version, a failing compiler
        logger.warning("report of %s: the mechanism could not be drawn: %r", plan.campaign_id, error)
        return None, f"The mechanism could not be drawn ({type(error).__name__}: {str(error)[:200]})."
    drawing = MechanismDrawing(
        sketch.width,
        sketch.height,
        sketch.text,
        sketch.areas,
        tuple(DrawnLine(*stroke) for stroke in sketch.strokes),
        sketch.dots,
        tuple(DrawnWords(*word) for word in sketch.words),
        tuple(LegendEntry(*entry) for entry in sketch.legend),
    )
    return drawing, ""
