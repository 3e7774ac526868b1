"""Plots of pages, and the pages that hold them."""
