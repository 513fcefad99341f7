"""Which bodies are linked to one another by what holds them together now."""

from engine.jit import inner, kernel


@kernel
def link_bodies(model, state, least, root):
    """Write a number for each body, the ground last, into ``root``, (nb + 1,), the same for bodies that are linked.

    Links are joints between bodies, motions, springs that pull, bushings, loaded contacts, and friction of joints
    whose speed is at most ``least``. Neither an ideal joint to the ground, which may allow a motion, nor a spring that
    only pushes is one; a motion links its bodies to the ground.
    """
    rows, loads, contacts, ground = model.bilateral, model.loads, model.contacts, root.shape[0] - 1
    for body in range(root.shape[0]):
        root[body] = body
    for i in range(rows.kind.shape[0]):
        a, b = rows.a[i], rows.b[i]
        if rows.acts[i] and a != ground and b != ground:
            _link(root, a, b)
        if rows.acts[i] and rows.law[i] >= 0:
            _link(root, a, ground)
            _link(root, b, ground)
    for i in range(loads.spring_body.shape[0]):
        if loads.spring_law[i, 4] <= 0.0:
            _link(root, loads.spring_body[i, 0], loads.spring_body[i, 1])
    bushings = loads.bushings
    for i in range(bushings.body.shape[0]):
        if bushings.law[i, 0] > 0.0 or bushings.law[i, 1] > 0.0 or bushings.law[i, 2] > 0.0:
            _link(root, bushings.body[i, 0], bushings.body[i, 1])
    for i in range(contacts.kind.shape[0]):
        if state.r[i, 0] > 0.0 and (contacts.bound[i] == 0.0 or state.slip[i] <= least):
            _link(root, contacts.a[i], contacts.b[i])
    for body in range(root.shape[0]):
        root[body] = _root(root, body)


@inner
def _link(root, a, b):
    root[_root(root, a)] = _root(root, b)


@inner
def _root(root, body):
    while root[body] != body:
        root[body] = root[root[body]]
        body = root[body]
    return body
