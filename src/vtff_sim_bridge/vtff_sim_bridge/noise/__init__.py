"""Random numbers of the emulators: one stream for each source, and noise with a memory."""
