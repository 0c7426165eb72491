"""Scenario files with one entry for many deputies: the entry is repeated as often as is asked for.

An entry of ``spacecraft`` with the field ``repeat`` stands for that many deputies. In its texts
``{number}`` is 1, 2, 3...; a mapping ``{first: a, increment: b}`` in place of a number is
a + (number - 1) b::

    - name: deputy_{number}
      role: deputy
      repeat: 3
      orbit:
        same_orbit_ahead: {first: 1000.0, increment: 200.0}
"""

from __future__ import annotations

from typing import Any

from vtff_sim_bridge.truth.scenario_fields import ScenarioError

__all__ = ["repeat_spacecraft"]

_REPEAT = "repeat"
_SERIES = {"first", "increment"}

#: Deputies that one entry may stand for; each has processes of its own.
LARGEST_REPEAT = 1000


def repeat_spacecraft(fields: Any, file: str, number_of_deputies: int = 0) -> Any:
    """Return the fields of a scenario file with every deputy in an entry of its own.

    Parameters
    ----------
    fields
        What the file holds; anything but a mapping with a list of spacecraft is returned as it is.
    file
        Name of the file for messages.
    number_of_deputies
        How many deputies the scenario shall have; 0 for as many as the file says.

    Raises
    ------
    ScenarioError
        If ``repeat`` is not a whole number from 1 to `LARGEST_REPEAT`, the file cannot have that
        many deputies, or a series is not one of numbers.
    """
    spacecraft = fields.get("spacecraft") if isinstance(fields, dict) else None
    if not isinstance(spacecraft, list):
        return fields
    repeated = [
        index
        for index, entry in enumerate(spacecraft)
        if isinstance(entry, dict) and _REPEAT in entry
    ]
    if number_of_deputies and not repeated and number_of_deputies != len(spacecraft) - 1:
        raise ScenarioError(
            f"{file}: spacecraft: {number_of_deputies} deputies are asked for, the file lists "
            f"{len(spacecraft) - 1} and has no entry with 'repeat'"
        )
    if len(repeated) > 1:
        raise ScenarioError(f"{file}: spacecraft[{repeated[1]}].repeat: only one entry may have it")
    if not repeated:
        return fields
    index = repeated[0]
    entry = dict(spacecraft[index])
    count = entry.pop(_REPEAT)
    if isinstance(count, bool) or not isinstance(count, int) or not 1 <= count <= LARGEST_REPEAT:
        raise ScenarioError(
            f"{file}: spacecraft[{index}].repeat: a whole number from 1 to {LARGEST_REPEAT} "
            f"expected, got {count!r}"
        )
    if number_of_deputies > LARGEST_REPEAT:
        raise ScenarioError(
            f"{file}: spacecraft: {number_of_deputies} deputies are asked for, at most "
            f"{LARGEST_REPEAT} can be"
        )
    if number_of_deputies:
        count = number_of_deputies - (len(spacecraft) - 2)
        if count < 1:
            raise ScenarioError(
                f"{file}: spacecraft: {number_of_deputies} deputies are asked for, the file lists "
                f"{len(spacecraft) - 2} beside the repeated one"
            )
    where = f"{file}: spacecraft[{index}]"
    copies = [_numbered(entry, number, where) for number in range(1, count + 1)]
    return {**fields, "spacecraft": [*spacecraft[:index], *copies, *spacecraft[index + 1 :]]}


def _numbered(value: Any, number: int, where: str) -> Any:
    """Return a value of the repeated entry as it is for one number."""
    if isinstance(value, dict):
        if set(value) == _SERIES:
            return _term(value, number, where)
        return {key: _numbered(item, number, f"{where}.{key}") for key, item in value.items()}
    if isinstance(value, list):
        return [_numbered(item, number, f"{where}[{at}]") for at, item in enumerate(value)]
    return value.replace("{number}", str(number)) if isinstance(value, str) else value


def _term(series: dict[str, Any], number: int, where: str) -> float:
    """Return the term of a series for one number."""
    for key, value in series.items():
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            raise ScenarioError(f"{where}.{key}: a number expected, got {value!r}")
    try:
        return float(series["first"] + (number - 1) * series["increment"])
    except OverflowError:
        raise ScenarioError(f"{where}: the numbers are too large") from None
