from typing import Any

import pytest

from mhsb_model.files.value_paths import ValuePathError, get_value, set_value


def content() -> dict[str, Any]:
    return {"a": {"b": [1.0, {"c": 2.0}]}, "left_out": None}


def test_a_value_is_found_and_set_by_its_path() -> None:
    given = content()
    assert get_value(given, "a.b.1.c") == 2.0
    set_value(given, "a.b.1.c", 3.0)
    set_value(given, "a.b.0", 5.0)
    assert given["a"]["b"] == [5.0, {"c": 3.0}]


def test_a_section_that_was_left_out_begins_with_its_first_value() -> None:
    given = content()
    set_value(given, "left_out.x", 1.0)
    set_value(given, "left_out.y", 2.0)
    assert given["left_out"] == {"x": 1.0, "y": 2.0}


@pytest.mark.parametrize(
    ("path", "sentence"),
    [
        ("a.x", "a.x: there is no 'x'; valid are b"),
        ("a.b.2", "there is no '2'; valid are 0, 1"),
        ("a.b.0.c", "there is no 'c'; nothing is below a single value"),
        ("", "there is no ''; valid are a, left_out"),
    ],
)
def test_a_path_that_leads_nowhere_tells_where_it_goes_wrong(path: str, sentence: str) -> None:
    with pytest.raises(ValuePathError) as error:
        get_value(content(), path)
    assert sentence in str(error.value)
