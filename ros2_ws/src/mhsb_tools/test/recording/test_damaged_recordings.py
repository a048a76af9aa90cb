"""Thousands of damaged recordings: nothing is lost that need not be, and what is lost is counted.

What must be kept is known without the code that is tested: a chunk whose bytes are all there in
the damaged file was not damaged, and its messages were read by the mcap library before.
"""

from __future__ import annotations

import random
import resource
import shutil
import struct
from collections import Counter
from pathlib import Path

import pytest
from rosbags.rosbag2 import Reader

from mhsb_tools.recording.bag_format import BagError
from mhsb_tools.recording.bag_reader import read_recording
from mhsb_tools.recording.bag_repair import Repair, repair_recording
from mhsb_tools.recording.mcap_records import CHUNK_TIMES, RECORD_HEADER

KINDS = (
    "own", "other", "split", "lz4", "zstd", "foreign", "without checksums", "with data checksum",
    "without index",
)  # fmt: skip
SAMPLE, WHOLE, PARTS = 100, 2000, 8
MEMORY = 64 * 1024  # KiB, above the process before


def flip(generator: random.Random, content: bytes, _: bytes) -> bytes:
    """Some bits are wrong, all over the file or close to each other."""
    changed = bytearray(content)
    place, reach = generator.randrange(len(content)), generator.choice([1, 16, len(content)])
    for _ in range(generator.choice([1, 1, 2, 8])):
        at = (place + generator.randrange(reach)) % len(content)
        changed[at] ^= generator.choice([1 << generator.randrange(8), 255])
    return bytes(changed)


def truncate(generator: random.Random, content: bytes, _: bytes) -> bytes:
    """The end is missing, or consists of zeros."""
    cut = content[: int(len(content) * generator.random())]
    return cut + bytes(generator.choice([0, 0, len(content) - len(cut)]))


def truncate_a_little(generator: random.Random, content: bytes, _: bytes) -> bytes:
    """A piece of the summary is missing."""
    return content[: -generator.randrange(1, 1500)]


def delete(generator: random.Random, content: bytes, _: bytes) -> bytes:
    """A part is missing."""
    at, length = generator.randrange(len(content)), generator.choice([1, 9, 500, 20_000])
    return content[:at] + content[at + generator.randrange(1, length + 1) :]


def insert(generator: random.Random, content: bytes, _: bytes) -> bytes:
    """Bytes that are none of it stand in it."""
    at, length = generator.randrange(len(content)), generator.choice([1, 9, 500, 20_000])
    junk = generator.randbytes(length) if generator.random() < 0.7 else bytes(length)
    return content[:at] + junk + content[at:]


def overwrite(generator: random.Random, content: bytes, other: bytes) -> bytes:
    """Bytes of another recording stand over it."""
    at, length = generator.randrange(len(content)), generator.choice([9, 500, 20_000])
    begin = generator.randrange(len(other))
    piece = other[begin : begin + length]
    return content[:at] + piece + content[at + len(piece) :]


def duplicate(generator: random.Random, content: bytes, _: bytes) -> bytes:
    """A part stands twice, the second time anywhere."""
    begin, length = generator.randrange(len(content)), generator.choice([9, 500, 40_000])
    at = generator.choice([begin + length, generator.randrange(len(content))])
    return content[:at] + content[begin : begin + length] + content[at:]


DAMAGES = (flip, truncate, truncate_a_little, delete, insert, overwrite, duplicate)


def splice(
    generator: random.Random, content: bytes, chunks: list[bytes], own: list[bytes]
) -> bytes:
    """A whole chunk, of this or of another recording, is put where another one begins."""
    piece, place = generator.choice(chunks), content.find(generator.choice(own))
    at = max(0, place)
    return content[:at] + piece + content[at:]


def damaged(
    generator: random.Random, content: bytes, own: list[bytes], other: bytes, foreign: list[bytes]
) -> tuple[bytes, bool]:
    """One to three kinds of damage in succession; and whether another recording is mixed in."""
    mixed = False
    for _ in range(generator.choice([1, 1, 1, 2, 3])):
        if not content:
            break
        if generator.random() < 0.15:
            chunks = generator.choice([own, foreign])
            mixed |= chunks is foreign
            content = splice(generator, content, chunks, own)
        else:
            damage = generator.choice(DAMAGES)
            mixed |= damage is overwrite
            content = damage(generator, content, other)
    return content, mixed


def snapshot(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def says_repair(folder: Path) -> bool:
    """Whether a reader refuses a recording as damaged."""
    try:
        read_recording(folder)
    except BagError as error:
        return "record --repair" in str(error)
    return False


def kept_messages(folder: Path) -> Counter[tuple[str, int, bytes]]:
    """What rosbags reads from a recording."""
    with Reader(folder) as reader:
        found = Counter((each.topic, time, bytes(data)) for each, time, data in reader.messages())
        assert found.total() == reader.message_count
    return found


def check(folder: Path, original, name: str, mixed: bool) -> str:
    """Repair a folder of which one file was damaged; returns what came of it.

    mixed: Parts of another recording stand in the file. Without its own summary nobody can know
        that they are, and count what is lost.
    """
    before = snapshot(folder)
    refused = says_repair(folder)
    assert snapshot(folder) == before
    try:
        done = repair_recording(folder)
    except BagError:
        done = None
    if done is None:
        assert snapshot(folder) == before
        assert refused
        assert not any(chunk in before[name] for chunk, _ in original.chunks[name])
        return "nothing"
    assert done.is_complete is not refused
    if done.is_complete:
        assert snapshot(folder) == before
        return "complete"
    after = snapshot(folder)
    for file, content in before.items():
        assert content in (after.get(file), after.get(f"{file}.torn")), f"{file} is lost"
    check_messages(folder, original, before, done, mixed)
    assert not says_repair(folder)
    assert repair_recording(folder).is_complete
    return "exact" if done.is_exact else "at least"


def check_messages(
    folder: Path, original, before: dict[str, bytes], done: Repair, mixed: bool
) -> None:
    kept = kept_messages(folder)
    assert kept.total() == done.kept
    contents = Counter()
    for (_, time, data), count in kept.items():
        contents[time, data] += count
    written, found = 0, 0
    for name, messages in original.written.items():
        written += len(messages)
        found += sum(min(1, contents[time, data]) for _, time, data in messages)
        for chunk, inside in original.chunks[name]:
            if chunk in before[name]:
                assert all(contents[time, data] for _, time, data in inside), "a good chunk is lost"
    has_summary = all(before[name].endswith(end) for name, end in original.ends.items())
    if folder.parent.name.startswith("without"):
        return  # nobody can see which messages have changed, or are of another recording
    if has_summary:
        assert done.is_exact
    if has_summary or (done.is_exact and not mixed):
        assert found + done.lost == written
    elif not mixed:
        assert found + done.lost <= written
    begins = all(chunks[0][0] in before[name] for name, chunks in original.chunks.items())
    if has_summary or (begins and not mixed):
        check_topics(kept, original)


def check_topics(kept: Counter[tuple[str, int, bytes]], original) -> None:
    """No message of the recording is on a topic that is not its own."""
    messages = [each for written in original.written.values() for each in written]
    topics = {(time, data): topic for topic, time, data in messages}
    for topic, time, data in kept:
        own = topics.get((time, data), topic)
        assert topic == own or topic.startswith("/unknown/"), f"{own} became {topic}"


def fuzz(originals, folder: Path, count: int, seed: int) -> Counter[str]:
    """Damage and repair that many recordings."""
    outcomes: Counter[str] = Counter()
    other = originals["second"]
    other_content = (other.folder / "bag_0.mcap").read_bytes()
    foreign = [chunk for chunk, _ in other.chunks["bag_0.mcap"]]
    for number in range(count):
        generator = random.Random(f"{seed} {number}")
        kind = generator.choice(KINDS)
        original = originals[kind]
        bag = folder / kind / "bag"
        shutil.copytree(original.folder, bag)
        path = generator.choice(sorted(bag.glob("*.mcap")))
        own = [chunk for chunk, _ in original.chunks[path.name]] or foreign
        content, mixed = damaged(generator, path.read_bytes(), own, other_content, foreign)
        path.write_bytes(content)
        if generator.random() < 0.3:
            (bag / "metadata.yaml").unlink()
        try:
            outcomes[check(bag, original, path.name, mixed)] += 1
        except Exception as error:
            raise AssertionError(f"{kind}, seed {seed}, recording {number}: {error!r}") from error
        shutil.rmtree(bag)
    return outcomes


def test_a_sample_of_damaged_recordings_keeps_every_good_chunk(originals, tmp_path, fresh_seed):
    assert fuzz(originals, tmp_path, SAMPLE, fresh_seed).total() == SAMPLE


@pytest.mark.parametrize("before", ["whole", "damaged", "missing"])
def test_an_index_of_wrong_length_does_not_cost_the_chunk_that_it_reaches_into(
    originals, tmp_path, before
):
    original = originals["other"]
    shutil.copytree(original.folder, tmp_path / "other" / "bag")
    path = tmp_path / "other" / "bag" / "bag_0.mcap"
    content = path.read_bytes()
    (ahead, _), (last, _) = original.chunks["bag_0.mcap"][-2:]
    at, end = content.find(ahead), content.find(ahead) + len(ahead)
    first = last.find(b"\x05", RECORD_HEADER.size + CHUNK_TIMES.size + 12)  # its first message
    # By as many bytes shorter, the index ends where a record within the next chunk begins.
    (length,) = struct.unpack_from("<Q", last, first + 1)
    cut = first + RECORD_HEADER.size + length
    chunk = {"whole": ahead, "damaged": ahead[:-1] + b"\xff", "missing": b""}[before]
    path.write_bytes(content[:at] + chunk + content[end : end + 100] + content[end + 100 + cut :])
    assert check(path.parent, original, path.name, mixed=False) == "exact"


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.parametrize("part", range(PARTS))
def test_two_thousand_damaged_recordings_keep_every_good_chunk(
    originals, tmp_path, fresh_seed, part
):
    fuzz(originals, tmp_path / "first", 20, fresh_seed)  # everything is loaded
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    outcomes = fuzz(originals, tmp_path / "all", WHOLE // PARTS, fresh_seed)
    print(f"part {part}: {dict(outcomes)}")
    assert {"exact", "at least"} < set(outcomes)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < MEMORY
