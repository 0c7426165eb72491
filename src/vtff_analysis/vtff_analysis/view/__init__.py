"""The viewer: a recorded or live run as a scene, and the page that shows it."""
