"""A journal in a bearing: the joint turns, and slides unless it is held axially (the paper's section 3.1)."""

from math import cos, pi
from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field

from engine.mechanism.base import (
    Each,
    Length,
    NonNegative,
    OptionalLength,
    PositiveLength,
    PositiveNumber,
    Radian,
    TableModel,
    added,
    are_numbers,
    is_number,
    numbers_or,
    optional,
    refuse,
    unless_none,
)
from engine.mechanism.joints import (
    LIMITS,
    AngleLimits,
    BreakawayForce,
    BreakawayTorque,
    FrictionForce,
    FrictionTorque,
    Joint,
    Line,
    OneWay,
    TravelLimits,
    stations,
)
from engine.mechanism.quantities import Quantity


def _radii(value: Any) -> float | tuple[float, ...]:
    """Read one positive radius, or one for each ring."""
    if is_number(value) and value > 0:
        return float(value)
    if are_numbers(value) and min(value) > 0:
        return tuple(map(float, value))
    raise refuse("not a radius; allowed: a number > 0, or a list with one number > 0 for each ring")


_ends = numbers_or(
    "not the two ends of a bearing; allowed: two numbers, the smaller first", 2, lambda ends: ends[0] <= ends[1]
)
_numbers = numbers_or("not a list of numbers; allowed: one finite number for each ring")


def _offsets(value: Any) -> tuple[tuple[float, ...], ...]:
    """Read one vector for each ring."""
    if not isinstance(value, list | tuple) or not value or not all(are_numbers(v, 3) for v in value):
        raise refuse("not a list of vectors; allowed: one [x, y, z] of finite numbers for each ring")
    return tuple(tuple(map(float, v)) for v in value)


class Lobes(TableModel):
    """The form of a bore or pin that is not round: so many arcs of equal radius, whose centres lie off the axis.

    A bore of arcs is narrowest in the middle of each, a pin is thickest at the tip of each lobe; two make an oval.
    """

    number: Annotated[int, Field(ge=2, le=12, strict=True)] = Field(description="how many there are, 2 to 12")
    height: Annotated[NonNegative, Quantity("length")] = Field(
        description="the largest less the smallest radius, which is the deviation from roundness, a number >= 0"
    )
    phase: Radian = Field(
        default=0.0, description="the angle of the first narrowest place of a bore, or tip of a pin, about the axis"
    )

    @property
    def offset(self) -> float:
        """How far the centres of the arcs are off the axis [length], to first order in height over radius."""
        return self.height / (1.0 - cos(pi / self.number))

    @property
    def angles(self) -> list[float]:
        """The angles of all narrowest places or tips."""
        return [self.phase + 2.0 * pi * i / self.number for i in range(self.number)]


LobedForm = Annotated[Lobes | None, added("its form, if it is not round: { number, height, phase }")]


class Journal(Line):
    """The pin; if it is centred in the bearing, its ``point`` coincides with the bearing's."""

    radius: Annotated[float | tuple[float, ...] | None, unless_none(_radii), Quantity("length"), Each(gt=0.0)] = (
        optional("the radius of the pin, a number > 0, or a list with one for each ring")
    )
    diameter: OptionalLength = added(
        "the diameter of the pin, a number > 0, in place of its radius; with that of the bearing"
    )
    lobes: LobedForm


class Bearing(Line):
    """The bore; its ``point`` is the joint's place on its body."""

    diameter: OptionalLength = added(
        "the diameter of the bore, a number > 0; with that of the journal, in place of radial_clearance"
    )
    lobes: LobedForm


class Flanges(TableModel):
    """Planes of the journal beyond the bearing's end faces; three points of each face can touch its flange."""

    radius: PositiveLength = Field(description="the radius on which the three points of an end face lie, a number > 0")
    sides: Literal["both", "start", "end"] = Field(
        default="both", description="the ends of the bearing that have a flange: both, start or end"
    )
    ends: Annotated[tuple[float, float] | None, unless_none(_ends), Quantity("length")] = optional(
        "the stations of the bearing's end faces; default: the first and the last ring"
    )
    phase: Radian = Field(
        default=0.0, description="the angle of the first of the three points about the bearing's axis"
    )


def ring_of(face: str) -> int:
    """Return the number of a ring, from 0, from the name of one of its contacts: ``ring2``, or ``ring2_1`` of lobes."""
    return int(face.removeprefix("ring").partition("_")[0]) - 1


class JournalJoint(Joint):
    """Base class of the joints made of a journal in a bearing: radial clearance at the rings of the bore."""

    SIDES: ClassVar[tuple[str, str]] = ("bearing", "journal")
    CLEARANCE: ClassVar[str] = "radial_clearance"
    CLEARANCES: ClassVar[tuple[str, ...]] = ("radial_clearance", "taper")
    bearing: Bearing = Field(description="the bore: { body, point, axis, diameter, lobes, deviation }")
    journal: Journal = Field(description="the pin: { body, point, axis, radius or diameter, lobes, deviation }")
    rings: Annotated[tuple[float, ...] | None, unless_none(stations), Quantity("length")] = optional(
        "the stations of the bearing's rings along its axis, one or more numbers"
    )
    radial_clearance: Annotated[Length | None, Quantity("length")] = optional(
        "bore radius minus journal radius, the same at every ring, a number > 0; with a ring_stiffness it may be "
        "negative, the interference of a press fit"
    )
    ring_stiffness: Annotated[PositiveNumber | None, Quantity("stiffness")] = added(
        "the radial force per displacement of a pin that a ring presses all round, a number > 0; default: rigid"
    )
    ring_damping: Annotated[NonNegative | None, Quantity("damping")] = added(
        "what that force has more per speed, a number >= 0"
    )
    radial_clearance_limit: OptionalLength = optional("the largest clearance the bore as drawn allows")
    taper: Annotated[tuple[float, ...] | None, unless_none(_numbers), Quantity("length")] = added(
        "by how much the clearance at each ring exceeds radial_clearance, one number for each ring"
    )
    ring_offsets: Annotated[
        tuple[tuple[float, float, float], ...] | None, unless_none(_offsets), Quantity("length")
    ] = added(
        "how far the centre of each ring is off the bearing's axis, as of bores in two walls: one vector"
        " for each ring, in the frame of the body"
    )

    @property
    def radii(self) -> tuple[float, ...]:
        """Journal radius at each ring [length], one value per ring."""
        radius, rings = self.journal.radius, self.rings or ()
        if self.journal.diameter is not None:
            radius = 0.5 * self.journal.diameter
        return radius if isinstance(radius, tuple) else (radius or 0.0,) * len(rings)

    @property
    def clearance_limit(self) -> float:
        """The largest radial clearance that may be set [length]."""
        limit = self.radial_clearance_limit
        return min(self.radii) if limit is None else limit

    @property
    def least_clearance(self) -> float:
        """The radial clearance above which all are allowed [length]; negative is an interference."""
        return 0.0 if self.ring_stiffness is None else -min(self.radii)

    @property
    def _by_diameters(self) -> bool:
        """Whether the clearance follows from the diameters of bore and pin."""
        return self.bearing.diameter is not None and self.journal.diameter is not None

    def face_clearance(self, face: str) -> str:
        """Return the key of the clearance at a ring."""
        return "bearing.diameter" if self._by_diameters else self.CLEARANCE

    def play(self, face: str) -> float:
        """Return the radial clearance at a ring."""
        taper = self.taper[ring_of(face)] if self.taper is not None else 0.0
        if self._by_diameters:
            return 0.5 * ((self.bearing.diameter or 0.0) - (self.journal.diameter or 0.0)) + taper
        return (self.radial_clearance or 0.0) + taper

    def _check_play(self) -> None:
        self._need("rings")
        self._check_rings()

    def _check_diameters(self) -> None:
        """Refuse one diameter without the other, or both beside what follows from them."""
        for side, other in (("bearing", "journal"), ("journal", "bearing")):
            if getattr(self, side).diameter is not None and getattr(self, other).diameter is None:
                text = f"needs that of the {other}, from which it leaves the clearance; add {other}.diameter"
                raise refuse(f"{text}, or give radial_clearance in its place", key=f"{side}.diameter")
        for key, value in (("journal.radius", self.journal.radius), ("radial_clearance", self.radial_clearance)):
            if self._by_diameters and value is not None:
                text = "follows from the diameters of bearing and journal; allowed: one of the two ways; remove it"
                raise refuse(text, key=key, value=value)

    def _check_rings(self) -> None:
        """Refuse rings that do not fit the pin, or a clearance that does not fit the bore."""
        self._check_diameters()
        if not self._by_diameters:
            self._need("journal.radius", "radial_clearance")
        rings = self.rings or ()
        if len(self.radii) != len(rings):
            text = f"{len(self.radii)} radii for {len(rings)} rings; allowed: one number, or one for each ring; give "
            raise refuse(f"{text}as many", key="journal.radius", value=list(self.radii))
        for key, stated in (("taper", self.taper), ("ring_offsets", self.ring_offsets)):
            if stated is not None and len(stated) != len(rings):
                text = f"{len(stated)} entries for {len(rings)} rings; allowed: one for each ring; give as many"
                raise refuse(text, key=key, value=list(stated))
        if self.journal.lobes is not None and not self.journal.lobes.offset < min(self.radii):
            text = f"more than the pin has; allowed: {self.journal.lobes.number} lobes of a small part of its radius"
            raise refuse(text, key="journal.lobes.height", value=self.journal.lobes.height)
        self._check_springs()
        self._check_clearances()

    def _check_springs(self) -> None:
        """Refuse a damping of rigid rings, and elastic rings that are not round."""
        if self.ring_stiffness is None:
            if self.ring_damping is not None:
                text = "a rigid ring has no damping of its own; allowed: with a ring_stiffness; give one, or remove it"
                raise refuse(text, key="ring_damping", value=self.ring_damping)
            return
        for side in ("bearing", "journal"):
            if getattr(self, side).lobes is not None:
                text = "elastic rings are round; allowed: without ring_stiffness; remove one of the two"
                raise refuse(text, key=f"{side}.lobes")

    def _check_clearances(self) -> None:
        """Refuse the clearances at the rings that there cannot be."""
        limit = self.clearance_limit
        for i in range(len(self.rings or ())):
            self._check_clearance(self.play(f"ring{i + 1}"), limit)

    def _check_clearance(self, clearance: float, limit: float) -> None:
        """Refuse a clearance at a ring above a limit, or one that is none at a rigid ring."""
        least = self.least_clearance
        if not least < clearance <= limit:
            what = "no play" if clearance <= 0 else "more than the bore as drawn allows"
            key = self.face_clearance("ring1")
            remedy = "choose a clearance in between, or give another radial_clearance_limit"
            if clearance <= 0 and self.ring_stiffness is None:
                remedy = "choose a clearance in between, or give a ring_stiffness if the pin is pressed in"
            raise refuse(
                f"{what}; allowed: {least:g} < {self._in_words} <= {limit:g}; {remedy}",
                key=key,
                value=self.bearing.diameter if self._by_diameters else clearance,
            )

    @property
    def _in_words(self) -> str:
        """The radial clearance, as it follows from the keys that are given."""
        words = "(bearing.diameter - journal.diameter) / 2" if self._by_diameters else "radial_clearance"
        return words if self.taper is None else f"{words} + taper"


class Cylindrical(JournalJoint):
    """A journal that turns and slides in its bearing."""

    type: Literal["cylindrical", "clearance_cylindrical"] = Field(description="the kind of joint")
    limits: TravelLimits | None = added(LIMITS)
    friction_force: FrictionForce
    breakaway_force: BreakawayForce
    friction_torque: FrictionTorque
    breakaway_torque: BreakawayTorque


class Revolute(JournalJoint):
    """A journal that turns in its bearing; flanges limit how far it slides."""

    CLEARANCES: ClassVar[tuple[str, ...]] = ("radial_clearance", "taper", "axial_clearance")
    type: Literal["revolute", "clearance_revolute"] = Field(description="the kind of joint")
    limits: AngleLimits | None = added(LIMITS)
    friction_torque: FrictionTorque
    breakaway_torque: BreakawayTorque
    one_way: OneWay
    flanges: Flanges | None = optional("the axial stops: { radius, sides, ends, phase }")
    axial_clearance: OptionalLength = optional("the play at each flange when the journal is centred, a number > 0")

    def face_clearance(self, face: str) -> str:
        """Return the key of the clearance at a ring or flange."""
        return "axial_clearance" if face.startswith("flange") else super().face_clearance(face)

    def play(self, face: str) -> float:
        """Return the clearance at a ring or flange."""
        return (self.axial_clearance or 0.0) if face.startswith("flange") else super().play(face)

    def carries(self, face: str) -> int:
        """Return the side whose body the clearance at a face is a length of: the journal has the flanges."""
        return int(face.startswith("flange"))

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
