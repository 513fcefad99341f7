"""Parameters follow from numbers and from each other, in any order of the file; what is wrong with one is named."""

from engine.mechanism.keys.key_paths import parameter_values
from tests.each import each


def test_values_in_the_order_of_the_file():
    """An expression may stand before what it uses."""
    values, faults = parameter_values({"half": "arm / 2", "arm": 12, "third": "half * 2/3"})
    assert faults == []
    assert list(values.items()) == [("half", 6.0), ("arm", 12.0), ("third", 4.0)]


@each(
    ("table", "said"),
    [
        ({"a": "b", "b": "c + 1", "c": "a"}, "follows from itself: "),
        ({"a": "a + 1"}, "parameters.a = 'a + 1': follows from itself: a -> a"),
        ({"a": "amr", "arm": 1.0}, "parameters.a = 'amr': amr is not a parameter; define it in [parameters]; did you"),
        ({"a": "12.0"}, "parameters.a = '12.0': not a finite number; give a number without quotes"),
        ({"a": True}, "parameters.a = true: not a finite number"),
        ({"a": [1.0]}, "parameters.a = [1.0]: not a finite number"),
        ({"a": float("nan")}, "parameters.a = nan: not a finite number"),
        ({"a": "1/(b - 2)", "b": 2}, "parameters.a = '1/(b - 2)': 1 / 0 is not a finite number"),
        ({"pi": 3.0}, "parameters.pi = 3.0: pi has a meaning in expressions"),
        ({"sqrt": 3.0}, "sqrt has a meaning in expressions"),
        ({"arm-length": 3.0}, "not a usable name; allowed: a letter, then letters, digits, '_'"),
        ({"a" * 61: 3.0}, "not a usable name"),
    ],
)
def test_faults(table, said):
    """One line for the parameter at fault; those that follow from it have no fault of their own."""
    values, faults = parameter_values({**table, "other": "1 + sound", "sound": 2})
    assert len(faults) == 1
    assert said in str(faults[0])
    assert values["sound"] == 2.0


def test_a_long_chain_is_quick_to_follow():
    """Ten thousand parameters, each from the one before: no recursion, no square of their number."""
    chain = {"p0": 1.0} | {f"p{i}": f"p{i - 1} + 1" for i in range(1, 10_000)}
    values, faults = parameter_values(chain)
    assert (faults, values["p9999"]) == ([], 10_000.0)
