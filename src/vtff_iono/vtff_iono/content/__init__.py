"""Electron content along the line of sight: slant TEC, absolute TEC, rate of TEC."""
