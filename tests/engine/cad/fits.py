"""A lever on a pin, with the tolerances of its drawing: a fit, zones of the bore, and others that nothing uses."""

from tests.engine.cad.step_files import Drawing, box, cut, cylinder, cylindrical, faces, fused, place

RADIUS, LENGTH = 6.0, 10.0


def lever(hole="H7", pin="g6", **position):
    """Return the drawing: hole and pin of 12 mm, both drawn with that diameter, and the keys of the bore's position."""
    made = Drawing()
    top = made.assembly("top")
    base = fused(box((-20, -20, -4), (40, 40, 4)), cylinder((0, 0, 0), RADIUS, LENGTH + 2))
    bar = cut(box((-10, -10, 0), (60, 20, LENGTH)), cylinder((0, 0, 0), RADIUS, LENGTH))
    products = {name: made.product(name, shape) for name, shape in (("base", base), ("lever", bar))}
    made.add(top, products["base"], place(), "base")
    made.add(top, products["lever"], place(z=0.1), "lever")
    bore, shaft = cylindrical(bar, RADIUS)[0], cylindrical(base, RADIUS)[0]
    for part, face, limits in (("lever", bore, hole), ("base", shaft, pin)):
        if limits:
            made.diameter(products[part], face, 2 * RADIUS, limits)
    if position:
        sides = [face for face in faces(bar) if not face.IsSame(bore)]
        made.zone(products["lever"], bore, "Position", datums=sides[:2], **position)
        made.zone(products["lever"], bore, "Perpendicularity", 0.02, datums=sides[:1])
        made.zone(products["lever"], sides[0], "Flatness", 0.03, is_round=False)
        made.zone(products["lever"], bore, "CircularityOrRoundness", 0.01, is_round=False)
    return made
