"""Whether others read what LEGATO exports."""
