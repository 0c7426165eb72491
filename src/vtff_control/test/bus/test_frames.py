"""A frame gives back the counts that it was made of, whichever byte of a signal comes first."""

import cantools
import numpy as np
import pytest

from vtff_control.bus.frames import encode_frame, find_damage

DATABASE = """VERSION ""
BU_: A B
BO_ 291 LowByteFirst: 8 A
 SG_ Checksum : 0|8@1+ (1,0) [0|0] "" B
 SG_ Nibble : 8|4@1+ (1,0) [0|0] "" B
 SG_ Count : 12|20@1- (1,0) [0|0] "" B
 SG_ Time : 32|30@1+ (0.5,3) [0|0] "" B
BO_ 292 HighByteFirst: 8 A
 SG_ Checksum : 7|8@0+ (1,0) [0|0] "" B
 SG_ Count : 15|20@0- (1,0) [0|0] "" B
 SG_ Flag : 24|1@0+ (1,0) [0|0] "" B
 SG_ Time : 39|31@0+ (1,0) [0|0] "" B
BO_ 293 Both: 6 A
 SG_ Checksum : 0|8@1+ (1,0) [0|0] "" B
 SG_ Low : 8|13@1- (1,0) [0|0] "" B
 SG_ High : 31|10@0- (1,0) [0|0] "" B
"""
MESSAGES = cantools.database.load_string(DATABASE, "dbc").messages


@pytest.mark.parametrize("message", MESSAGES, ids=lambda message: message.name)
def test_counts_are_read_back(message):
    generator = np.random.default_rng(1)
    for _ in range(100):
        values = {}
        for signal in message.signals:
            low = -(2 ** (signal.length - 1)) if signal.is_signed else 0
            values[signal.name] = int(generator.integers(low, low + 2**signal.length))
        frame = encode_frame(message, values)
        values["Checksum"] = frame.data[0]
        assert message.decode(frame.data, decode_choices=False, scaling=False) == values
        assert frame.arbitration_id == message.frame_id
        assert not find_damage(message, frame)
        frame.data[1] ^= 1
        assert "wrong checksum" in find_damage(message, frame)
