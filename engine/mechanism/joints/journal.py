"""A journal in a bearing: it turns, and slides unless it is held axially (the paper's section 3.1)."""

from typing import Annotated, Any, ClassVar, Literal

from pydantic import BeforeValidator, Field

from engine.mechanism.base import Length, Number, PositiveLength, TableModel, is_number, refuse
from engine.mechanism.components import Each
from engine.mechanism.joints.base import Joint, Line, stations
from engine.mechanism.quantities import Quantity


def _radii(value: Any) -> float | tuple[float, ...] | None:
    """Read one positive radius, or one for each ring."""
    if value is None:
        return None
    if is_number(value) and value > 0:
        return float(value)
    if isinstance(value, list | tuple) and value and all(is_number(r) and r > 0 for r in value):
        return tuple(float(r) for r in value)
    raise refuse("not a radius; allowed: a number > 0, or a list with one number > 0 for each ring")


def _ends(value: Any) -> tuple[float, float] | None:
    """Read the stations of the two end faces of a bearing."""
    if value is None:
        return None
    if not isinstance(value, list | tuple) or len(value) != 2 or not all(map(is_number, value)) or value[0] > value[1]:
        raise refuse("not the two ends of a bearing; allowed: two numbers, the smaller first")
    return (float(value[0]), float(value[1]))


class Journal(Line):
    """The pin; if it is centred in the bearing, its ``point`` coincides with the bearing's."""

    radius: Annotated[float | tuple[float, ...] | None, BeforeValidator(_radii), Quantity("length"), Each(gt=0.0)] = (
        Field(default=None, description="the radius of the pin, a number > 0, or a list with one for each ring")
    )


class Flanges(TableModel):
    """Planes of the journal beyond the bearing's end faces; three points of each face can touch its flange."""

    radius: PositiveLength = Field(description="the radius on which the three points of an end face lie, a number > 0")
    sides: Literal["both", "start", "end"] = Field(
        default="both", description="the ends of the bearing that have a flange: both, start or end"
    )
    ends: Annotated[tuple[float, float] | None, BeforeValidator(_ends), Quantity("length")] = Field(
        default=None, description="the stations of the bearing's end faces; default: the first and the last ring"
    )
    phase: Annotated[Number, Quantity("angle")] = Field(
        default=0.0, description="the angle of the first of the three points about the bearing's axis"
    )


class JournalJoint(Joint):
    """Base class of the joints made of a journal in a bearing: radial clearance at the rings of the bore."""

    SIDES: ClassVar[tuple[str, str]] = ("bearing", "journal")
    CLEARANCE: ClassVar[str] = "radial_clearance"
    CLEARANCES: ClassVar[tuple[str, ...]] = ("radial_clearance",)

    bearing: Line = Field(description="the bore: { body, point, axis }")
    journal: Journal = Field(description="the pin: { body, point, axis, radius }")
    rings: Annotated[tuple[float, ...] | None, BeforeValidator(stations), Quantity("length")] = Field(
        default=None, description="the stations of the bearing's rings along its axis, one or more numbers"
    )
    radial_clearance: Annotated[Length | None, Quantity("length")] = Field(
        default=None,
        description="bore radius minus journal radius, the same at every ring, a number > 0",
        json_schema_extra={"exclusiveMinimum": 0},
    )
    radial_clearance_limit: Annotated[PositiveLength | None, Quantity("length")] = Field(
        default=None,
        description="the largest clearance the bore as drawn allows",
    )

    @property
    def radii(self) -> tuple[float, ...]:
        """Journal radius at each ring [length], one value per ring."""
        radius, rings = self.journal.radius, self.rings or ()
        return radius if isinstance(radius, tuple) else (radius or 0.0,) * len(rings)

    @property
    def clearance_limit(self) -> float:
        """The largest radial clearance that may be set [length]."""
        limit = self.radial_clearance_limit
        return min(self.radii) if limit is None else limit

    def _check_play(self) -> None:
        self._need("rings")
        self._check_rings()

    def _check_rings(self) -> None:
        """Refuse rings that do not fit the pin, or a clearance that does not fit the bore."""
        self._need("journal.radius", "radial_clearance")
        rings, clearance = self.rings or (), self.radial_clearance or 0.0
        if len(self.radii) != len(rings):
            raise refuse(
                f"{len(self.radii)} radii for {len(rings)} rings; "
                "allowed: one number, or one for each ring; give as many",
                key="journal.radius",
                value=list(self.radii),
            )
        if not 0 < clearance <= self.clearance_limit:
            what = "no play" if clearance <= 0 else "more than the bore as drawn allows"
            raise refuse(
                f"{what}; allowed: 0 < radial_clearance <= {self.clearance_limit:g}; "
                "choose a clearance in between, or give another radial_clearance_limit",
                key="radial_clearance",
                value=clearance,
            )


class Cylindrical(JournalJoint):
    """A journal that turns and slides in its bearing."""

    type: Literal["cylindrical", "clearance_cylindrical"] = Field(description="the kind of joint")


class Revolute(JournalJoint):
    """A journal that turns in its bearing; flanges limit how far it slides."""

    CLEARANCES: ClassVar[tuple[str, ...]] = ("radial_clearance", "axial_clearance")

    type: Literal["revolute", "clearance_revolute"] = Field(description="the kind of joint")
    flanges: Flanges | None = Field(default=None, description="the axial stops: { radius, sides, ends, phase }")
    axial_clearance: Annotated[PositiveLength | None, Quantity("length")] = Field(
        default=None, description="the play at each flange when the journal is centred, a number > 0"
    )

    def face_clearance(self, face: str) -> str:
        """Return the key of the clearance at a ring or flange."""
        return "axial_clearance" if face.startswith("flange") else self.CLEARANCE

    @property
    def flange_stations(self) -> dict[str, float]:
        """Station of the end face at each flange [length], by the side of the flange: ``start``, ``end``."""
        if self.flanges is None:
            return {}
        start, end = self.flanges.ends or (min(self.rings or (0.0,)), max(self.rings or (0.0,)))
        return {side: s for side, s in (("start", start), ("end", end)) if self.flanges.sides in ("both", side)}

    def _check_play(self) -> None:
        if self.rings is not None or self.flanges is None:
            super()._check_play()
        elif self.flanges.ends is None:
            self._need("flanges.ends")
        if self.flanges is not None:
            self._need("axial_clearance")
        elif self.axial_clearance is not None:
            text = "nothing it would act on; allowed: together with flanges; add flanges = { radius }, or remove it"
            raise refuse(text, key="axial_clearance", value=self.axial_clearance)
