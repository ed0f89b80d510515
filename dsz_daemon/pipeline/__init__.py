"""Decode, align, encode, loop: pure and streaming."""
