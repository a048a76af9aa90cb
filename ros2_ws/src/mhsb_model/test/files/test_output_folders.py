from pathlib import Path

import pytest

from mhsb_model.errors import MhsbError
from mhsb_model.files.output_folders import make_output_folder, make_parent_folder


def test_a_folder_is_made_with_all_above_it_and_may_be_there_already(tmp_path: Path) -> None:
    wanted = tmp_path / "a" / "b"
    for _ in range(2):
        make_output_folder(wanted, "the run")
        assert wanted.is_dir()
    make_parent_folder(tmp_path / "c" / "page.png", "the picture")
    assert (tmp_path / "c").is_dir()


@pytest.mark.parametrize("below", ["", "deeper"])
def test_where_something_else_has_the_name_a_sentence_says_so(tmp_path: Path, below: str) -> None:
    file = tmp_path / "file"
    file.touch()
    with pytest.raises(MhsbError, match="is not a folder; name one for the run"):
        make_output_folder(file / below, "the run")
    with pytest.raises(MhsbError, match="is not a folder; name one for the picture"):
        make_parent_folder(file / below / "page.png", "the picture")
    with pytest.raises(MhsbError, match="is a folder; name a file for the picture"):
        make_parent_folder(tmp_path, "the picture")


def test_several_folders_are_not_made_for_one_file(tmp_path: Path) -> None:
    with pytest.raises(MhsbError, match=r"there is no folder .*a; make it, or name a file for"):
        make_parent_folder(tmp_path / "a" / "b" / "page.png", "the picture")
    assert not (tmp_path / "a").exists()
