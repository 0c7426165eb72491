"""Messages of a node about its inputs: reminders every few seconds, one line when all are there."""

from vtff_node.start.awaited_inputs import REMINDER_INTERVAL, AwaitedInputs


def test_reminders_are_rare_and_the_end_is_said_once():
    now, awaited, said = [0.0], ["/a", "/b"], []
    inputs = AwaitedInputs(lambda: awaited, said.append, lambda: now[0])
    inputs.look()
    assert said == []  # processes that start together find each other within the first seconds
    for second in range(1, 13):
        now[0] = float(second)
        inputs.look()
    assert REMINDER_INTERVAL == 5.0
    assert said == ["waiting for /a, /b"] * 2
    awaited.clear()
    inputs.look()
    awaited.append("/a")
    now[0] = 100.0
    inputs.look()
    assert said[2:] == ["whole: all inputs are there"]
    assert inputs.complete
