"""SimREMOTE, the remote-control language of SimGEN: text, motion and client."""
