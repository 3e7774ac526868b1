"""Pages for the browser: what was found, one HTML file each that needs nothing else."""

from .diagnosis import diagnosis_page
from .fleet import fleet_page
from .identification import identification_page
from .signs import signs_page
from .validation import validation_page

__all__ = ["diagnosis_page", "fleet_page", "identification_page", "signs_page", "validation_page"]
