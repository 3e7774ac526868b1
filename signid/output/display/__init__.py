"""Results in a Python session: repr, HTML in notebooks, tables by name, saved models."""

from .frames import frame as frame
from .save import save_model as save_model
from .text import html as html, text as text
