"""Mutations of files: of their bytes, of their text, and of the tables that they hold."""

import copy

EXTREMES = [
    *(0, -1, 1, 2**31, 2**63 - 1, 2**63, -(2**63), 10**400, True, False),
    *(0.0, -0.0, 5e-324, 1e-300, 1e300, 1.7976931348623157e308, float("nan"), float("inf"), float("-inf")),
    *(
        "",
        "\0",
        "\x1b[2J",
        "é\u202e\U0001f600",
        "a" * 5000,
        "../../x",
        "/etc/passwd",
        "/dev/zero",
        "1e999",
        "c60",
        "x.y",
    ),
    *([], {}, [[]], [{}], {"": {}}, {"x": 1}, ["a", "b"], list(range(50))),
    *([1.0, 2.0, 3.0], [0, 0, 0], [1e308, 1e308, 1e308]),
]
TOKENS = [
    *"[]{}=,.\"'#\n\r\t\0\\+-_0e",
    *("[[", "]]", '"""', "'''", "= =", "nan", "inf", "0x", "0b1", "1e999", "9" * 4400, "0x" + "f" * 4000, "[" * 900),
    *("a." * 200, "true", "1979-05-27", "1979-05-27T07:32:00Z", "07:32:00", "\ufeff", "\u2028", "\U0010ffff", "{a=1}"),
]


def mutate_bytes(random, content):
    """Return bytes with some of them flipped, cut, doubled, inserted, or exchanged."""
    changed = bytearray(content)
    for _ in range(random.choice((1, 1, 1, 3, 20))):
        at = random.randrange(len(changed) + 1)
        length = random.choice((1, 2, 8, 100, 1000))
        match random.randrange(6):
            case 0 if at < len(changed):
                changed[at] ^= 1 << random.randrange(8)
            case 1:
                del changed[at:]
            case 2:
                del changed[at : at + length]
            case 3:
                changed[at:at] = changed[at : at + length]
            case 4:
                changed[at:at] = random.randbytes(min(length, 20))
            case 5:
                other = random.randrange(len(changed) + 1)
                changed[at : at + length] = changed[other : other + length]
    return bytes(changed)


def mutate_text(random, text):
    """Return text with some of its tokens replaced, inserted, or its lines cut, doubled and exchanged."""
    for _ in range(random.choice((1, 1, 2, 5))):
        lines, at = text.split("\n"), random.randrange(len(text) + 1)
        first, second = random.randrange(len(lines)), random.randrange(len(lines))
        match random.randrange(6):
            case 0:
                text = text[:at] + random.choice(TOKENS) + text[at:]
            case 1:
                text = text[:at] + random.choice(TOKENS) + text[at + random.randrange(10) :]
            case 2:
                lines[first], lines[second] = lines[second], lines[first]
                text = "\n".join(lines)
            case 3:
                text = "\n".join(lines[:first] + lines[second:])
            case 4:
                text = "\n".join([*lines[:first], *lines[min(first, second) : second + 3], *lines[first:]])
            case 5:
                key, sign, _ = lines[first].partition("=")
                lines[first] = f"{key}{sign} {random.choice(TOKENS)}"
                text = "\n".join(lines)
    return text


def mutate_tables(random, document):
    """Return a document with some of its values, at any depth, replaced, removed, renamed, doubled or exchanged."""
    changed = copy.deepcopy(document)
    for _ in range(random.choice((1, 1, 1, 2, 4))):
        places = list(_places(changed))
        if not places:
            return changed
        owner, key = random.choice(places)
        if (isinstance(owner, dict) and key not in owner) or (isinstance(owner, list) and key >= len(owner)):
            continue
        _change(random, owner, key, places)
    return changed


def _change(random, owner, key, places):
    """Change one value of a table or list."""
    value = owner[key]
    match random.randrange(8):
        case 0 | 1:
            owner[key] = copy.deepcopy(random.choice(EXTREMES))
        case 2:
            del owner[key]
        case 3 if isinstance(owner, dict):
            owner[random.choice([f"{key}x", "", "é", "type", "x.y", "\x1b[2J", "a" * 300])] = owner.pop(key)
        case 4 if isinstance(value, int | float) and not isinstance(value, bool):
            factor = random.choice((-1, 0, 0.5, 2, 1e-12, 1e12, 1e300))
            owner[key] = (
                value * int(factor) if isinstance(value, int) and abs(factor) < 1e100 else float(str(value)) * factor
            )
        case 5:
            other, there = random.choice(places)
            if (isinstance(other, dict) and there in other) or (isinstance(other, list) and there < len(other)):
                owner[key] = copy.deepcopy(other[there])
        case 6:
            owner[key] = [copy.deepcopy(value)] * random.choice((1, 2, 3, 100))
        case 7:
            owner[key] = {random.choice(["x", "J1", ""]): value}


def _places(node):
    """Yield each table or list of a document with each of its keys."""
    for key, value in list(node.items() if isinstance(node, dict) else enumerate(node)):
        yield node, key
        if isinstance(value, dict | list):
            yield from _places(value)
