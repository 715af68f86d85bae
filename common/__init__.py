"""What every LEGATO process agrees on. Imports no service."""

__version__ = "0.1.0"
