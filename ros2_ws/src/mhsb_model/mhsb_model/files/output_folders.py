"""Folders for results, created before the work, and replacement of files as a whole."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from mhsb_model.errors import MhsbError


def make_output_folder(path: Path, purpose: str) -> None:
    """Create a folder for results and all its parents; an existing folder is left as it is.

    Args:
        path: Folder.
        purpose: Noun phrase for the error message, such as "the report" in "name one for the
            report".

    Raises:
        MhsbError: A part of the path exists and is not a folder.
        OSError: The folder cannot be created for another reason.
    """
    try:
        path.mkdir(parents=True, exist_ok=True)
    except (FileExistsError, NotADirectoryError):
        raise MhsbError(f"{path} is not a folder; name one for {purpose}") from None


@contextmanager
def replace_file(path: Path) -> Iterator[Path]:
    """Replace a file as a whole when the block ends, as a context manager.

    The block writes the new content to a temporary name. If the block succeeds, the temporary file
    is renamed, so the target is never incomplete. If the block raises, the temporary file is
    removed, and an older target stays.

    Args:
        path: The file; its folder must exist.

    Yields:
        The temporary name, in the same folder.
    """
    part = path.with_name(f"{path.name}.part")
    try:
        yield part
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)


def make_parent_folder(file: Path, purpose: str) -> None:
    """Create the parent folder of a file that is going to be written; do not create the file.

    At most one folder is created: a path with several unknown folders is likely to be misspelt.

    Args:
        file: File, which may exist.
        purpose: Noun phrase for the error message, such as "the picture" in "name a file for the
            picture".

    Raises:
        MhsbError: The path is a folder, a parent of it is a file, or more than one folder would
            have to be created.
        OSError: The folder cannot be created for another reason.
    """
    if file.is_dir():
        raise MhsbError(f"{file} is a folder; name a file for {purpose}")
    if not file.parent.is_dir() and not file.parent.parent.exists():
        raise MhsbError(
            f"there is no folder {file.parent.parent}; make it, or name a file for {purpose} in a "
            "folder that is there"
        )
    make_output_folder(file.parent, purpose)
