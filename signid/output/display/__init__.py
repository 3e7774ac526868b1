"""Results in a Python session: repr, HTML in notebooks, tables by name, saved models."""

from .frames import frame as frame
from .text import html as html, save_model as save_model, text as text
