"""The description of a mechanism as a whole: its tables, what follows from several of them, and its checks."""

import hashlib
import json
import re
from collections.abc import Collection, Iterable, Iterator, Mapping
from functools import cached_property
from html import escape
from inspect import Parameter, Signature
from types import FunctionType
from typing import Annotated, Any, Literal, Self

import numpy as np
import tomli_w
from pydantic import (
    BaseModel,
    Field,
    PrivateAttr,
    SerializerFunctionWrapHandler,
    ValidationError,
    model_serializer,
    model_validator,
)
from pydantic_core import PydanticCustomError

from engine.errors import Fault, MechanismError
from engine.mechanism.base import (
    Name,
    Number,
    TableModel,
    Vector,
    added,
    check_static,
    optional,
)
from engine.mechanism.benches import NAMED, Bench, Plot, Preset, with_bench
from engine.mechanism.bodies import Body
from engine.mechanism.bushings import Beam, Bushing
from engine.mechanism.contacts import Contact
from engine.mechanism.couplings import Coupling
from engine.mechanism.expression import ExpressionFault, parse
from engine.mechanism.faults import MOST_FAULTS, did_you_mean, faults_of, listed
from engine.mechanism.geometry.cad_table import GeometryCertificate
from engine.mechanism.joints import Fixed, Joint, Planar, Prismatic, Spherical
from engine.mechanism.journals import Cylindrical, Revolute
from engine.mechanism.keys.key_paths import (
    PREFIX,
    Place,
    Uses,
    along,
    conflicting_units,
    formulas_in,
    parameter_units,
    parameter_values,
    unused_parameters,
    with_formulas,
)
from engine.mechanism.loads import Damper, Force, FrictionOverSpeed, Motion, Rotation, Spring, Torque
from engine.mechanism.material_pairs import MOST_ACROSS, Material
from engine.mechanism.materials import REFERENCE, expansion_of
from engine.mechanism.meshes.certificate import MeshCertificate
from engine.mechanism.quantities import Quantity, UnitSystem, fits, quantity_of, quantity_with_unit
from engine.mechanism.references import pair_between, reference_faults
from engine.mechanism.responses import (
    Derived,
    Event,
    Formula,
    Impulse,
    Mean,
    MotionTravel,
    Response,
    ResponseDifference,
    ValidityCondition,
    in_formulas,
    order_of_derived,
)
from engine.mechanism.simulation import Phase, Simulation

AnyJoint = Annotated[
    Revolute | Cylindrical | Prismatic | Spherical | Fixed | Planar | Bushing | Beam, Field(discriminator="type")
]


class _ShortHelp(type(BaseModel)):  # type: ignore[misc]  # a metaclass that pydantic does not name
    """Lists what is a mechanism's own, so that ``help()`` is not of pydantic's methods and of types of keys."""

    def __dir__(cls) -> list[str]:
        return [name for name, of in vars(cls).items() if not name.startswith(("_", "model_")) and isinstance(of, _OWN)]


# tomli-w writes each element of an array in a line, also of a point.
_SHORT_ARRAY = re.compile(r"""\[((?:\n *(?:[-+.\w]+|"[^"\\\n]*"),){1,4})\n *\]""")
_OWN = (FunctionType, classmethod, staticmethod, property, cached_property)


class Mechanism(TableModel, metaclass=_ShortHelp):
    """A mechanism: its bodies, joints, contacts, loads and responses.

    Created by `load_mechanism` from a TOML file, or from its tables as Python data. It is immutable: `set_values`
    returns a copy with other numbers, `extended` one with other tables; `to_dict` and `to_toml` lead back.
    """

    format: Literal[1] = Field(description="the version of the file format: 1")
    name: Name = Field(description="the name of the mechanism")
    title: str = Field(default="", description="what the mechanism is called in a report")
    description: str = Field(default="", description="what the mechanism is, in a few sentences")
    units: UnitSystem = Field(description='the unit system of all numbers: "mm-g-ms" or "SI"')
    gravity: Annotated[Vector, Quantity("acceleration")] = Field(
        default=(0.0, 0.0, 0.0), description="the acceleration of gravity, in the world"
    )
    temperature: Annotated[Annotated[Number, Field(gt=-273.15, le=1000)] | None, Quantity("temperature")] = added(
        "the temperature of all bodies, whose lengths in the file are those at 20 degC; default: 20"
    )
    validity: tuple[ValidityCondition, ...] = Field(
        default=(), description='the conditions a valid result meets, such as "latch_overlap > 0"'
    )
    parameters: dict[Name, Number] = Field(
        default={}, description="numbers with a name, used in expressions in the place of other numbers"
    )
    simulation: Simulation = Field(description="the defaults of a run")
    phases: Annotated[tuple[Phase, ...], Field(min_length=1)] = Field(
        default=(Phase(name="run"),), description="the parts of a run, in order"
    )
    materials: dict[Name, Material] = Field(default={}, description="pairs of materials")
    bodies: dict[Name, Body] = Field(description="the rigid bodies")
    joints: dict[Name, AnyJoint] = Field(default={}, description="the joints")
    couplings: dict[Name, Coupling] = Field(
        default={},
        exclude_if=lambda value: not value,  # so that the digests of earlier mechanisms stay
        description="couplings of joint coordinates, and pairs of gears",
    )
    contacts: dict[Name, Contact] = Field(default={}, description="the contacts")
    springs: dict[Name, Spring] = Field(default={}, description="the springs")
    dampers: dict[Name, Damper] = Field(default={}, description="the dampers")
    forces: dict[Name, Force] = Field(default={}, description="the forces")
    torques: dict[Name, Torque] = Field(default={}, description="the torques")
    motions: dict[Name, Motion] = Field(default={}, description="the prescribed motions")
    responses: dict[Name, Response] = Field(default={}, description="what is read off")
    bench: Name | None = optional("the bench the mechanism is on; written by on_bench")
    plot: Plot | None = optional("two responses to draw against each other: { x, y }")
    benches: dict[Name, Bench] = Field(
        default={}, description="test benches: tables of this file that are added to it, and what is taken away"
    )
    presets: dict[Name, Preset] = Field(default={}, description="named sets of values, such as a measured prototype's")
    geometry: GeometryCertificate | None = optional(
        "what came from a CAD file, and how exactly; written by load_mechanism"
    )
    meshes: dict[str, MeshCertificate] = Field(
        default={},
        exclude_if=lambda value: not value,
        description="how far the pieces of meshes are from these; written by load_mechanism",
    )

    _formulas: dict[str, str] = PrivateAttr(default_factory=dict)

    @property
    def formulas(self) -> dict[str, str]:
        """Key -> expression, for each number that the file gives as an expression."""
        return self._formulas

    def __repr__(self) -> str:
        """Return name and size, in a line; a mechanism has thousands of numbers."""
        counts = [f"{len(names)} {table}" for table, names in self._named().items()]
        return f"<Mechanism {self.name}: {', '.join(counts)}>"

    __str__ = __repr__

    def _repr_html_(self) -> str:
        """Return the HTML that a notebook shows: the names in each table."""
        rows = "".join(
            f"<tr><th>{table}</th><td>{len(names)}</td><td>{escape(', '.join(names))}</td></tr>"
            for table, names in self._named().items()
        )
        return f"<p>{escape(self.title or self.name)}, {self.units}</p><table>{rows}</table>"

    def _named(self) -> dict[str, list[str]]:
        """Return the names in each table that has any."""
        return {table: list(getattr(self, table)) for table in NAMED if getattr(self, table)}

    def to_dict(self) -> dict[str, Any]:
        """Return the tables of the mechanism's file, as `load_mechanism` takes them.

        Expressions stay expressions, geometry of a CAD file is numbers, and what was not given is not there.
        """
        return self.model_dump(
            mode="json", by_alias=True, exclude_unset=True, exclude_none=True, exclude={"geometry", "meshes"}
        )

    def to_toml(self) -> str:
        """Return the text of the mechanism's file, without the comments of the one it was read from."""
        dumped = tomli_w.dumps(self.to_dict())
        return _SHORT_ARRAY.sub(
            lambda found: f"[{' '.join(line.strip() for line in found[1].splitlines())[1:-1]}]", dumped
        )

    def extended(self, *, without: Collection[str] = (), **tables: Any) -> "Mechanism":
        """Return the mechanism with tables added, replaced or taken away.

        Parameters
        ----------
        without : collection of str
            Tables to take away, each as ``TABLE.NAME``, such as "contacts.stop".
        **tables : mapping
            Tables to add by name, such as ``bodies={"pawl": {"mass": 3.0, ...}}``; one that is there is replaced. In
            ``simulation`` and ``parameters`` the keys given are replaced, and any other key as a whole.

        Raises
        ------
        MechanismError
            With one line for each fault of the resulting mechanism.
        """
        data = self.to_dict()
        for path in without:
            table, _, entry = path.partition(".")
            if entry not in data.get(table, {}) or table not in NAMED:
                known = [f"{t}.{e}" for t in NAMED for e in data.get(t, {})]
                text = f"{self.name}: without = {path!r:.80}: no such table; allowed: TABLE.NAME of one that is there"
                raise MechanismError(text + did_you_mean(path, known))
            del data[table][entry]
        merged = {*NAMED, "parameters", "simulation", "benches", "presets"}
        for key, given in tables.items():
            data[key] = {**data.get(key, {}), **given} if key in merged and isinstance(given, Mapping) else given
        return mechanism_from(python_data(data), self.name)

    def with_tables(self, tables: Mapping[str, Any], formulas: dict[str, str]) -> "Mechanism":
        """Return the mechanism with some tables, checked beforehand, and the formulas replaced."""
        changed = self.model_copy(update=tables)
        changed._formulas = formulas
        changed.__dict__.pop("parameter_units", None)  # the copy has the cached value of its original
        return changed

    @model_serializer(mode="wrap")
    def _as_written(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Dump with expressions instead of their numbers, and without an empty table of parameters."""
        dump: dict[str, Any] = with_formulas(self, self._formulas, handler(self))
        return dump if self.parameters else {key: entry for key, entry in dump.items() if key != "parameters"}

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        faults = reference_faults(self.model_dump(by_alias=True))
        if faults:
            raise PydanticCustomError("references", "references", {"faults": faults})
        return self

    def static_friction_faults(self) -> Iterator[Fault]:
        """Yield the contacts and joints that stick with less friction than that with which they slide."""
        for table in ("joints", "contacts"):
            for name, pair in getattr(self, table).items():
                if pair.static_friction is not None and not getattr(pair, "ideal", False):
                    try:
                        check_static(pair.static_friction, self.contact_law(pair)[0])
                    except PydanticCustomError as error:
                        yield Fault((table, name, "static_friction"), str(error), pair.static_friction)

    def grain_faults(self) -> Iterator[Fault]:
        """Yield what has a grain and no friction across it, or the other way round, or two that hardly compare."""
        for name, joint in self.joints.items():
            if not joint.ideal and self.friction_across(joint) is not None:
                text = f"missing; materials.{self._pair_of(joint)} differs along and across a grain, and a joint has "
                yield Fault(("joints", name, "friction"), f"{text}none; allowed: a number >= 0; give it its own")
        for name, contact in self.contacts.items():
            along, across, side = self.contact_law(contact)[0], self.friction_across(contact), contact.grained
            if side is None and across is not None:
                text = f"missing; materials.{self._pair_of(contact)} differs along and across a grain; allowed: "
                text += "[x, y, z], the direction in the frame of its body; add it to the side that has the grain"
                yield Fault(("contacts", name, "a", "grain"), text)
            elif side is not None and across is None:
                text = "missing; a side has a grain; allowed: a number > 0; add it, or remove the grain"
                yield Fault(("contacts", name, "friction_across"), text)
            elif across is not None and not across / MOST_ACROSS <= along <= across * MOST_ACROSS:
                text = f"too far from {along:g} along the grain; allowed: a {MOST_ACROSS:g}th to {MOST_ACROSS:g} times "
                yield Fault(("contacts", name, "friction_across"), f"{text}that; correct one of the two", across)

    def response_units(self) -> dict[str, str]:
        """Return the unit of every response, by name."""
        return {name: self._quantity(name).unit(self.units) for name in self.responses}

    def _quantity(self, name: str) -> Quantity:
        """Return the quantity of a response; a formula without one, which `quantity_faults` reports, has a number's."""
        response = self.responses[name]
        if isinstance(response, ResponseDifference):
            return self._quantity(response.of[0])
        if isinstance(response, Formula):
            try:
                return self._quantity_of_formula(response)
            except ExpressionFault:
                return Quantity("number")
        if isinstance(response, Mean):
            return self._quantity(response.response)
        if isinstance(response, MotionTravel) and isinstance(self.motions[response.motion], Rotation):
            return Quantity("angle")
        return response.quantity

    def _quantity_of_formula(self, response: Formula) -> Quantity:
        """Return the quantity of a formula; raise ExpressionFault if it has none, or not the one that is stated."""
        known, units = in_formulas(self.responses), self.parameter_units
        names = {
            part: self._quantity(known[part]) if part in known else quantity_with_unit(units[part], self.units)
            for part in response.sources
        }
        node = parse(response.formula)
        if response.stated is None:
            return quantity_of(node, names)
        if not fits(Quantity(response.stated), node, names):
            raise ExpressionFault(f"its result is not of the kind of {response.stated}; correct it, or quantity")
        return Quantity(response.stated)

    def quantity_faults(self) -> list[Fault]:
        """Return the faults in what formulas and differences measure, such as a force less a length."""
        known, faults, wrong = in_formulas(self.responses), [], set[str]()
        for name, response in self.responses.items():
            if isinstance(response, Impulse) and self._quantity(response.response).name != "force":
                text = f"of a response in {self._quantity(response.response).unit(self.units)}; allowed: a force"
                faults.append(Fault(("responses", name, "response"), text, response.response))
        for name in order_of_derived(self.responses):
            response = self.responses[name]
            if isinstance(response, Derived) and wrong.intersection(known.get(part, "") for part in response.sources):
                wrong.add(name)  # the fault is that of what it follows from
            elif isinstance(response, Formula):
                try:
                    self._quantity_of_formula(response)
                except ExpressionFault as fault:
                    wrong.add(name)
                    faults.append(Fault(("responses", name, "formula"), str(fault), response.formula))
            elif isinstance(response, ResponseDifference) and len({self._quantity(r).name for r in response.of}) > 1:
                text = "of two quantities; allowed: responses of one quantity, such as two forces; name others"
                faults.append(Fault(("responses", name, "of"), text, list(response.of)))
        return faults

    def contact_law(self, pair: Joint | Contact) -> tuple[float, float]:
        """Return (friction, restitution): its own; else of the pair it names; else of the pair of its bodies."""
        material = self._material_of(pair)
        return (
            material.friction if pair.friction is None else pair.friction,
            (0.0 if pair.spring[0] else material.restitution) if pair.restitution is None else pair.restitution,
        )

    def static_friction(self, pair: Joint | Contact) -> float:
        """Return the coefficient of friction of a contact that sticks."""
        if (over_speed := self.friction_over_speed(pair)) is not None:
            return self.contact_law(pair)[0] * over_speed.at_rest
        given = pair.static_friction
        if given is None and pair.friction is None:
            given = self._material_of(pair).static_friction
        return max(self.contact_law(pair)[0], given or 0.0)

    def friction_across(self, pair: Joint | Contact) -> float | None:
        """Return the coefficient of friction across the grain, its own or its material's; None without any."""
        own: float | None = getattr(pair, "friction_across", None)
        return self._material_of(pair).friction_across if own is None and pair.friction is None else own

    def friction_over_speed(self, pair: Joint | Contact) -> FrictionOverSpeed | None:
        """Return what friction is multiplied with over the sliding speed: its own table or its material's, if any."""
        own: FrictionOverSpeed | None = getattr(pair, "friction_over_speed", None)
        if own is None and pair.friction is None and pair.static_friction is None:
            own = self._material_of(pair).friction_over_speed
        return own

    def rolling_friction(self, contact: Contact) -> tuple[float, float]:
        """Return the largest moments of a contact against rolling and spinning, per normal force."""
        material, own = self._material_of(contact), (contact.rolling_friction, contact.spinning_friction)
        others = material.rolling_friction, material.spinning_friction
        return tuple((other or 0.0) if mine is None else mine for mine, other in zip(own, others, strict=True))  # type: ignore[return-value]

    def _material_of(self, pair: Joint | Contact) -> Material:
        """Return the pair of materials that it names, or that of its bodies; one without friction if there is none."""
        name = self._pair_of(pair)
        return self.materials[name] if name else Material(friction=0.0)

    def _pair_of(self, pair: Joint | Contact) -> str | None:
        bodies = [self.bodies[side.body].material for side in pair.sides]
        between = {name: material.between for name, material in self.materials.items()}
        return pair.material or pair_between(bodies, between)

    def stretch(self, body: str) -> float:
        """Return the factor of all lengths of a body: 1 at 20 degC without growth (ISO 1)."""
        made = self.bodies[body]
        factor = 1.0 if made.growth is None else 1.0 + made.growth
        if self.temperature is None:
            return factor
        expansion = expansion_of(made.material or "") if made.expansion is None else made.expansion
        return factor * (1.0 + (expansion or 0.0) * (self.temperature - REFERENCE))

    def unit_at(self, place: Place) -> str:
        """Return the unit of the number at a place that is not a parameter; ``"1"`` for a pure number."""
        if isinstance(place.owner, Event):
            return self.response_units()[place.owner.response]
        quantity = place.quantity()
        return quantity.unit(self.units) if quantity else "1"

    @cached_property
    def parameter_units(self) -> dict[str, str]:
        """Unit of each parameter, deduced from its use; ``"1"`` for a pure number or if its use shows no unit."""
        certain, likely = self._uses(scaled=False), self._uses(scaled=True)
        told = {name: [*certain.get(name, ()), *likely.get(name, ())] for name in self.parameters}
        return {name: next((unit for unit in units if unit != "1"), "1") for name, units in told.items()}

    def parameter_faults(self) -> list[Fault]:
        """Return the faults in the use of parameters: used in two units, or not used at all."""
        elsewhere = [*self.response_formulas().values(), *(bench.model_dump() for bench in self.benches.values())]
        unused = () if self.bench else unused_parameters(self.parameters, self._formulas, elsewhere)
        return [*unused, *conflicting_units(self._uses(scaled=False), self.parameters)]

    def response_formulas(self) -> dict[str, str]:
        """Return the formulas of responses, which may use parameters, too, by their keys."""
        found = {name: r.formula for name, r in self.responses.items() if isinstance(r, Formula)}
        return {f"responses.{name}.formula": text for name, text in found.items()}

    def _uses(self, *, scaled: bool) -> Uses:
        """Return the units in which each parameter is used, each with one of the keys that use it."""
        places = {key: along(self, key.split("."))[-1] for key in self._formulas if not key.startswith(PREFIX)}
        told = {key: place for key, place in places.items() if place.quantity() or isinstance(place.owner, Event)}
        units = {key: self.unit_at(place) for key, place in told.items()}
        return parameter_units(self._formulas, units, scaled=scaled)

    def unit(self, quantity: str) -> str:
        """Return the unit of a quantity, such as ``"length"`` or ``"time"``, in this mechanism's unit system."""
        return Quantity(quantity).unit(self.units)

    def on_bench(self, name: str) -> "Mechanism":
        """Return the mechanism modified for one of its test benches.

        Raises
        ------
        MechanismError
            If there is no such bench, or with one line for each fault of the resulting mechanism.
        """
        _refuse_unknown(self.name, "bench", name, self.benches)
        data = self.model_dump(by_alias=True, exclude_unset=True)
        return mechanism_from(with_bench(data, name, self.benches[name]), f"{self.name} on bench {name}")

    def preset(self, name: str) -> dict[str, float]:
        """Return a named set of values, key -> number.

        Raises
        ------
        MechanismError
            If there is no such preset.
        """
        _refuse_unknown(self.name, "preset", name, self.presets)
        return dict(self.presets[name].values)

    def loose_joints(self) -> list[str]:
        """Return the names of the joints that can be used as the key of a clearance."""
        joints = self.joints.items()
        return [name for name, joint in joints if not joint.ideal and getattr(joint, joint.CLEARANCE) is not None]

    def digest(self) -> str:
        """Return the sha256 of the description in canonical form, 64 hexadecimal digits.

        Comments, spaces and the order of keys inside a table do not matter. The order of bodies, joints and contacts
        does, because the engine adds numbers up in this order. Of a CAD file only the numbers taken from it matter.
        """
        data = self.model_dump(mode="json", by_alias=True, exclude={"geometry", "meshes"})
        return hashlib.sha256(json.dumps(data, separators=(",", ":"), ensure_ascii=True).encode()).hexdigest()


Mechanism.__signature__ = Signature([Parameter("tables", Parameter.VAR_KEYWORD)])


def _refuse_unknown(mechanism: str, kind: str, name: str, known: Iterable[str]) -> None:
    """Raise an error if a mechanism has no bench or preset of this name."""
    if name not in known:
        names = ", ".join(known) or "it has none"
        raise MechanismError(f"{mechanism}: no {kind} {name!r}; allowed: {names}{did_you_mean(name, known)}")


def python_data(value: Any) -> Any:
    """Return tables that a program has built as those of a file: dicts, lists and plain numbers."""
    if isinstance(value, TableModel):
        return value.model_dump(mode="json", by_alias=True, exclude_unset=True, exclude_none=True)
    if isinstance(value, Mapping):
        return {str(key): python_data(inner) for key, inner in value.items() if inner is not None}
    if isinstance(value, list | tuple):
        return [python_data(inner) for inner in value]
    return value.tolist() if isinstance(value, np.ndarray | np.generic) else value


def mechanism_from(data: dict[str, Any], source: str) -> Mechanism:
    """Return a file's mechanism, checked; raise MechanismError with all its faults under the name ``source``."""
    table = data.get("parameters", {})
    values, faults = parameter_values(table) if isinstance(table, dict) else ({}, [])
    if faults:  # otherwise every use of such a parameter would be a fault, too
        raise refused(source, faults, len(faults))
    try:
        read = {**data, "parameters": values} if values else data
        mechanism = Mechanism.model_validate(read, context=values)
    except ValidationError as error:
        system: UnitSystem = "SI" if data.get("units") == "SI" else "mm-g-ms"
        faults, count = faults_of(error, Mechanism, system), error.error_count()
        if error.errors()[0]["type"] == "references":  # found again below, in the file itself
            faults, count = [], 0
        references = reference_faults(data)
        raise refused(source, faults + references, count + len(references)) from None
    formulas = dict(formulas_in(Place(mechanism), data))
    mechanism = mechanism.with_tables({}, formulas)
    found = (mechanism.parameter_faults, mechanism.quantity_faults, mechanism.static_friction_faults)
    if faults := [fault for find in (*found, mechanism.grain_faults) for fault in find()]:
        raise refused(source, faults, len(faults))
    return mechanism


def refused(source: str, faults: list[Fault], count: int) -> MechanismError:
    """Return the error that lists the faults of a file; ``count`` is their number including any not listed."""
    lines = "\n".join(f"  {fault}" for fault in listed(faults, count))
    return MechanismError(f"{source}: {count} fault{'s' if count > 1 else ''}\n{lines}", faults[:MOST_FAULTS])
