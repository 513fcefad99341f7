"""What engineers call things for which a file has no key of that name, and their recipes in docs/modelling.md."""

RECIPES = {
    "A pair of gears, with backlash": "gear belt chain pulley coupler spline tooth",
    "A rack, a screw": "rack pinion screw thread spindle",
    "A planetary set": "planet epicyclic",
    "A motor": "motor engine",
    "A solenoid or magnet": "solenoid magnet electro",
    "A progressive, bistable or gas spring": "bistable progressive gas nonlinear dome snap_disc",
    "A one-way clutch": "clutch freewheel ratchet one_way overrunning",
    "A brake, or the friction of a guide or hinge": "brake bearing_friction seal stiction",
    "A rope, and a spring that lifts off": "rope cable wire tension_only",
    "An end stop that bounces": "limit stop range",
    "A press fit": "press_fit interference",
    "The effort, stroke and energy of a push-button": "effort stroke actuation operating_force",
    "What there is none of yet, and what to do instead": "mesh stl universal cardan hooke snap beam leaf flex"
    " bushing rolling bearing",
}
"""The titles of recipes, and what in the name of a key or type asks for one."""


def recipe_for(word: str) -> str:
    """Return `; see "TITLE" in docs/modelling.md` for an unknown key or type, or an empty text if no recipe fits."""
    asked = f"_{word.lower().replace('-', '_')}"  # a known word begins a part of it: a track is no rack
    titles = [title for title, words in RECIPES.items() if any(f"_{known}" in asked for known in words.split())]
    return f'; see "{titles[0]}" in docs/modelling.md' if titles else ""
