"""Learned policies: networks and losses. The only place that imports torch (extra `[policy]`).

`config`, `presets`, `images` and `normalization` do without torch, for deployment without it.
"""
