"""Densities and thermal expansion of materials by name, typical of common grades at room temperature.

Densities of metals and glass follow EN 1991-1-1 (steel), EN 10088-1 (stainless steel), EN 1561 (cast iron), EN 1999-1-1
(aluminium), EN 572-1 (glass), and handbook values of the usual alloys: CuZn39Pb3 (brass), CuSn8 (bronze), ZP5 (zinc),
AZ91 (magnesium), TiAl6V4 (titanium). Plastics are dry, by ISO 1183, as on the suppliers' sheets of unmodified grades. A
grade may differ by some percent.

Coefficients of expansion follow EN 1993-1-1 (steel), EN 10088-1 (stainless steel), EN 1999-1-1 (aluminium) and EN 572-1
(glass); of the other metals W. D. Callister, Materials Science and Engineering, appendix B, and for ZP5 ASTM B86. Those
of plastics follow R. J. Crawford, Plastics Engineering, table 1.8, and suppliers' sheets by ISO 11359-2 (from 23 to 55
degC); with fibres, and in FR4, they are those along the fibres. A plastic may differ by a fifth.
"""

from collections.abc import Mapping

from engine.mechanism.faults import did_you_mean

# density in g/mm3, coefficient of linear thermal expansion in 1/K
_MATERIALS: dict[str, tuple[float, float | None]] = {
    "steel": (7.85e-3, 12e-6),
    "stainless steel": (7.9e-3, 16e-6),
    "cast iron": (7.2e-3, 11.4e-6),
    "aluminium": (2.7e-3, 23e-6),
    "magnesium": (1.81e-3, 26e-6),
    "titanium": (4.43e-3, 8.6e-6),
    "brass": (8.47e-3, 20.5e-6),
    "bronze": (8.8e-3, 18e-6),
    "copper": (8.96e-3, 17e-6),
    "zinc": (6.7e-3, 27.4e-6),
    "glass": (2.5e-3, 9e-6),
    "FR4": (1.85e-3, 15e-6),
    "ABS": (1.05e-3, 90e-6),
    "PA6": (1.13e-3, 90e-6),
    "PA6-GF30": (1.36e-3, 25e-6),
    "PA66": (1.14e-3, 90e-6),
    "PA66-GF30": (1.37e-3, 30e-6),
    "PA12": (1.01e-3, 110e-6),
    "PBT": (1.31e-3, 110e-6),
    "PBT-GF30": (1.53e-3, 30e-6),
    "PC": (1.2e-3, 65e-6),
    "PC-ABS": (1.14e-3, 80e-6),
    "PE-HD": (0.95e-3, 150e-6),
    "PEEK": (1.3e-3, 48e-6),
    "PETG": (1.27e-3, None),
    "PLA": (1.24e-3, None),
    "PMMA": (1.19e-3, 70e-6),
    "POM": (1.41e-3, 110e-6),
    "PP": (0.905e-3, 100e-6),
    "PPS-GF40": (1.65e-3, 25e-6),
    "PTFE": (2.17e-3, 140e-6),
}
DENSITIES = {name: density for name, (density, _) in _MATERIALS.items()}
EXPANSIONS = {name: expansion for name, (_, expansion) in _MATERIALS.items() if expansion is not None}
REFERENCE = 20.0  # degC, at which drawings state sizes (ISO 1)

_OTHER_NAMES = {"aluminum": "aluminium", "iron": "cast iron", "nylon": "PA66", "acetal": "POM", "HDPE": "PE-HD"}


def density_of(name: str) -> float | None:
    """Return the density of a material in g/mm3; None if none has this name. Capitals, spaces, hyphens do not count."""
    return _named(DENSITIES, name)


def expansion_of(name: str) -> float | None:
    """Return the coefficient of expansion of a material in 1/K, as `density_of` its density."""
    return _named(EXPANSIONS, name)


def _named(table: Mapping[str, float], name: str) -> float | None:
    named = {**table, **{other: table[each] for other, each in _OTHER_NAMES.items()}}
    return {_plain(each): number for each, number in named.items()}.get(_plain(name))


def unknown_material(name: str) -> str:
    """Return what is wrong with the name of a material that is not in the table."""
    known = f"{', '.join(DENSITIES)}{did_you_mean(name, DENSITIES)}"
    return f"no material of this name; allowed: a number > 0, or one of {known}; write its density as a number"


def _plain(name: str) -> str:
    return "".join(c for c in name.casefold() if c.isalnum())
