"""Bridge to Spirent SimGEN over SimREMOTE, and an emulator of it."""
