"""The whole story at once: a robot with physics that its simulation lacks is recorded, diagnosed and proved."""

from .document import story_document as story_document
from .run import Story as Story
from .run import demo as demo
from .words import by_hand as by_hand
from .words import story_end as story_end
from .words import story_tables as story_tables
