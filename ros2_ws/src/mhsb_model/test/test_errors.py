"""Errors as they are handed from one process to another."""

import pickle

from mhsb_model.errors import MachineFileError, OutOfWorkspaceError


def test_an_error_keeps_its_sentence_and_its_data_on_its_way_to_another_process():
    for error in (MachineFileError("arm.yaml", ["a", "b"]), OutOfWorkspaceError((1.0, 2.0), "far")):
        other = pickle.loads(pickle.dumps(error))
        assert type(other) is type(error)
        assert str(other) == str(error)
        assert vars(other) == vars(error)
