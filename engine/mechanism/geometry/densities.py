"""Densities of materials by name, typical of common grades at room temperature.

Metals and glass follow EN 1991-1-1 (steel), EN 10088-1 (stainless steel), EN 1561 (cast iron), EN 1999-1-1 (aluminium),
EN 572-1 (glass), and handbook values of the usual alloys: CuZn39Pb3 (brass), CuSn8 (bronze), ZP5 (zinc), AZ91
(magnesium), TiAl6V4 (titanium). Plastics are dry, by ISO 1183, as on the suppliers' sheets of unmodified grades. A
grade may differ by some percent.
"""

from engine.mechanism.faults import did_you_mean

DENSITIES = {
    "steel": 7.85e-3,
    "stainless steel": 7.9e-3,
    "cast iron": 7.2e-3,
    "aluminium": 2.7e-3,
    "magnesium": 1.81e-3,
    "titanium": 4.43e-3,
    "brass": 8.47e-3,
    "bronze": 8.8e-3,
    "copper": 8.96e-3,
    "zinc": 6.7e-3,
    "glass": 2.5e-3,
    "FR4": 1.85e-3,
    "ABS": 1.05e-3,
    "PA6": 1.13e-3,
    "PA6-GF30": 1.36e-3,
    "PA66": 1.14e-3,
    "PA66-GF30": 1.37e-3,
    "PA12": 1.01e-3,
    "PBT": 1.31e-3,
    "PBT-GF30": 1.53e-3,
    "PC": 1.2e-3,
    "PC-ABS": 1.14e-3,
    "PE-HD": 0.95e-3,
    "PEEK": 1.3e-3,
    "PETG": 1.27e-3,
    "PLA": 1.24e-3,
    "PMMA": 1.19e-3,
    "POM": 1.41e-3,
    "PP": 0.905e-3,
    "PPS-GF40": 1.65e-3,
    "PTFE": 2.17e-3,
}
"""Densities in g/mm3, by the name of the material."""

_OTHER_NAMES = {"aluminum": "aluminium", "iron": "cast iron", "nylon": "PA66", "acetal": "POM", "HDPE": "PE-HD"}


def density_of(name: str) -> float | None:
    """Return the density of a material in g/mm3; None if the table has none of this name.

    Capitals, spaces, hyphens and underscores do not count.
    """
    known = {_plain(each): density for each, density in DENSITIES.items()}
    known |= {_plain(other): DENSITIES[each] for other, each in _OTHER_NAMES.items()}
    return known.get(_plain(name))


def unknown_material(name: str) -> str:
    """Return what is wrong with the name of a material that is not in the table."""
    return (
        f"no material of this name; allowed: a number > 0, or one of {', '.join(DENSITIES)}"
        f"{did_you_mean(name, DENSITIES)}; write its density as a number"
    )


def _plain(name: str) -> str:
    return "".join(c for c in name.casefold() if c.isalnum())
