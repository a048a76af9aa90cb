"""Posture tables from strangers: bounded before anything is allocated, one sentence each."""

import io
import json
import resource
import struct
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mhsb_planner.errors import TableError
from mhsb_planner.posture.npz_reader import NPY_HEADER_PATTERN, read_arrays
from mhsb_planner.posture.s1_posture_table import PostureTable


def npy(header, payload=b"", version=1):
    """An npy file with this header, whatever it says."""
    form = "<H" if version == 1 else "<I"
    text = header.encode() if isinstance(header, str) else header
    return b"\x93NUMPY" + bytes([version, 0]) + struct.pack(form, len(text)) + text + payload


def shaped(shape, descr="<f8"):
    return f"{{'descr': '{descr}', 'fortran_order': False, 'shape': {shape}, }}\n"


def text_array(text):
    file = io.BytesIO()
    np.save(file, np.array(text))
    return file.getvalue()


@pytest.fixture
def members(table, tmp_path):
    """Function (changes) that writes the table with some members replaced; None leaves one out."""
    table.save(tmp_path / "good.npz")
    with zipfile.ZipFile(tmp_path / "good.npz") as file:
        good = {name: file.read(name) for name in file.namelist()}

    def write(compression=zipfile.ZIP_STORED, **changes):
        path = tmp_path / "bad.npz"
        with zipfile.ZipFile(path, "w", compression) as file:
            for name, content in (good | {f"{k}.npy": v for k, v in changes.items()}).items():
                if content is not None:
                    file.writestr(name, content)
        return path

    return write


DAMAGED = Path(__file__).parent / "damaged_tables"
DEEP = 200_000
BAD_MEMBERS = {
    "a shape of 1e15": {"nodes": npy(shaped("(1000000000000, 1000)", "<i8"))},
    "a shape of 1e60": {"nodes": npy(shaped("(" + "999999999999, " * 5 + ")", "<i8"))},
    "a shape that is text": {"area": npy(shaped("('a',)"))},
    "a shape below 0": {"area": npy(shaped("(-1, 5)"))},
    "an npy header 2e5 deep": {"area": npy("(" * DEEP, version=2)},
    "an npy header of 64 KiB": {"area": npy(" " * 65_000)},
    "a JSON header 2e5 deep": {"header": text_array("[" * DEEP)},
    "a JSON header 9,000 deep": {"header": text_array("[" * 9_000)},
    "a JSON header that is a list": {"header": text_array("[1, 2]")},
    "a JSON number of 9,000 digits": {"header": text_array('{"spacing": ' + "9" * 9_000 + "}")},
    "objects": {"nodes": npy(shaped("(1,)", "|O8"), b"\x80\x04N.")},
    "a structure": {"nodes": npy("{'descr': [('a', '<i8')], 'fortran_order': False, "
                                 "'shape': (1,), }\n", bytes(8))},
    "another byte order": {"nodes": npy(shaped("(1, 2)", ">i8"), bytes(16))},
    "another kind of number": {"area": npy(shaped("(1, 2)", "<f4"), bytes(8))},
    "code": {"area": npy("{'descr': __import__('os').system('true'), }\n")},
    "no array at all": {"area": b""},
    "a header cut off": {"area": npy(shaped("(1,)"))[:20]},
    "a missing array": {"posture": None},
    "too few bytes": {"area": npy(shaped("(642, 23)"), bytes(8))},
}  # fmt: skip


@pytest.mark.parametrize("name", BAD_MEMBERS)
def test_a_member_that_is_not_what_numpy_writes_is_refused_in_one_sentence(members, name, machine):
    path = members(**BAD_MEMBERS[name])
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(TableError, match="is damaged or not a posture table"):
        PostureTable.load(path, machine)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 64 * 1024  # KiB


@pytest.mark.parametrize("compression", [zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA, zipfile.ZIP_DEFLATED])
def test_compressed_tables_are_read(members, machine, compression):
    assert PostureTable.load(members(compression), machine).feasible.any()


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"spacing": 1e999}, "its spacing is inf m"),
        ({"spacing": 0}, "its spacing is 0 m"),
        ({"spacing": 10**400}, "has no usable header"),
        ({"schema_version": "x" * 9_000}, "has schema version x{80}, 1 is needed"),
        ({"machine_hash": "x" * 9_000}, "was made for machine mhsb_arm3 .x{12}.,"),
    ],
)
def test_a_header_of_impossible_values_is_refused(members, machine, table, change, sentence):
    header = {
        "schema_version": 1,
        "machine_name": table.machine_name,
        "machine_hash": table.machine_hash,
        "spacing": table.spacing,
    }
    path = members(header=text_array(json.dumps(header | change)))
    with pytest.raises(TableError, match=sentence):
        PostureTable.load(path, machine)


def test_numbers_that_no_table_of_this_machine_has_are_refused(table, tmp_path, machine):
    far = table.nodes.copy()
    far[3] = 2**62
    other = table.patterns.copy()
    other[0] = 1
    beyond = table.posture.copy()
    beyond[np.flatnonzero(table.feasible)[0], 0, 0] = 7.0
    unknown = table.posture.copy()
    unknown[np.flatnonzero(table.feasible)[0], 0, 0] = np.nan
    for changed, sentence in (
        (replace(table, nodes=far), "nodes lie beyond the arm's reach"),
        (replace(table, patterns=other), "its mode patterns are not those of the machine"),
        (replace(table, posture=beyond), "postures lie beyond the joint limits"),
        (replace(table, posture=unknown), "postures lie beyond the joint limits"),
    ):
        changed.save(tmp_path / "changed.npz")
        with pytest.raises(TableError, match=f"is damaged: {sentence}"):
            PostureTable.load(tmp_path / "changed.npz", machine)


def test_the_header_is_that_of_numpy_itself():
    for shape in ((), (3,), (3, 4), (3, 4, 5)):
        file = io.BytesIO()
        np.save(file, np.zeros(shape))
        assert NPY_HEADER_PATTERN.fullmatch(file.getvalue()[10 : 10 + file.getvalue()[8]])


def test_arrays_come_back_as_numpy_reads_them(tmp_path):
    random = np.random.default_rng(1)
    arrays = {
        "a": random.normal(size=(3, 4, 5)),
        "b": np.asfortranarray(random.normal(size=(7, 2))),
        "c": np.array("text"),
        "d": np.empty((0, 3)),
    }
    np.savez(tmp_path / "file.npz", **arrays)
    kinds = {"a": "<f8", "b": "<f8", "c": r"<U\d+", "d": "<f8"}
    found = read_arrays(tmp_path / "file.npz", kinds, 2**20)
    with np.load(tmp_path / "file.npz") as known:
        for name, array in found.items():
            np.testing.assert_array_equal(array, known[name])
            assert array.dtype == known[name].dtype


def test_every_damage_of_a_byte_is_noticed_or_harmless(table, tmp_path, machine, fresh_seed):
    """Flips of random bits: the table comes back as it was, or is refused in one sentence."""
    table.save(tmp_path / "good.npz")
    seed = fresh_seed
    good, random = (tmp_path / "good.npz").read_bytes(), np.random.default_rng(seed)
    for _ in range(150):
        content = bytearray(good)
        at = int(random.integers(len(content)))
        if random.random() < 0.5:  # the zip's own directory, and the headers, are a small part
            at = int(random.choice([at % 600, len(content) - 1 - at % 600]))
        content[at] ^= 1 << int(random.integers(8))
        path = tmp_path / "flipped.npz"
        path.write_bytes(content)
        try:
            again = PostureTable.load(path, machine)
        except TableError:
            continue
        assert again.posture.tobytes() == table.posture.tobytes(), f"seed {seed}, byte {at}"


@pytest.mark.parametrize("file", sorted(DAMAGED.iterdir()), ids=lambda file: file.stem)
def test_files_that_coverage_guided_fuzzing_found_are_refused_in_one_sentence(file, machine):
    """Each of them once ended the reader with an exception of a library."""
    with pytest.raises(TableError) as refused:
        PostureTable.load(file, machine)
    assert "\n" not in str(refused.value)
