"""Structured arrays have the fields that the class of their records declares."""

from mhsb_model.records import Int32, Record, create_records, record_dtype


class Spool(Record):
    position: float
    steps: int
    place: Int32


def test_the_fields_of_a_record_are_those_of_its_class():
    assert record_dtype(Spool).descr == [("position", "<f8"), ("steps", "<i8"), ("place", "<i4")]
    assert create_records(Spool, 2).tolist() == [(0.0, 0, 0)] * 2
