"""TensorBoard reads the events of a run as the user will see them."""

from tensorboard.backend.event_processing.event_accumulator import EventAccumulator
from tensorboard.backend.event_processing.event_file_loader import EventFileLoader


def scalar(value):
    # The loader turns old-style scalars into tensors.
    return value.tensor.float_val[0] if value.HasField("tensor") else value.simple_value


def test_the_loader_reads_every_record(sample_run):
    first, second = sorted(sample_run.glob("events.out.tfevents.*"))
    events = list(EventFileLoader(str(first)).Load())
    assert events[0].file_version == "brain.Event:2"
    values = {(event.step, value.tag): scalar(value) for event in events for value in event.summary.value}
    totals = {(step, "return/total"): step / 8 for step in range(100, 700, 100)}
    assert values == totals | {(step, "gait/alternation"): 0.5 for step in (200, 400, 600)}
    assert [event.step for event in EventFileLoader(str(second)).Load()] == [0, 301, 400, 500, 600, 700, 800]


def test_a_resumed_run_shows_every_step_once(sample_run):
    accumulator = EventAccumulator(str(sample_run))
    accumulator.Reload()
    assert [event.step for event in accumulator.Scalars("return/total")] == list(range(100, 900, 100))
