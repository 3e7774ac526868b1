"""What is found, in words and numbers: tables for the eye, JSON for programs, files that are never half-written."""

import sys
from typing import TYPE_CHECKING

from ..registry import inner_package as _package

if TYPE_CHECKING:
    from .conversion import conversion_document as conversion_document
    from .conversion import conversion_tables as conversion_tables
    from .data import data_card as data_card
    from .data import data_document as data_document
    from .data import data_tables as data_tables
    from .diagnosis import diagnosis_document as diagnosis_document
    from .diagnosis_tables import diagnosis_tables as diagnosis_tables
    from .documents import check_document as check_document
    from .documents import identification_document as identification_document
    from .documents import inspection_document as inspection_document
    from .documents import to_json as to_json
    from .effects import effects_document as effects_document
    from .effects import effects_tables as effects_tables
    from .factors import factors_document as factors_document
    from .factors import factors_tables as factors_tables
    from .fleet import fleet_tables as fleet_tables
    from .motions import excitation_document as excitation_document
    from .motions import excitation_tables as excitation_tables
    from .numbers import figure as figure
    from .numbers import with_interval as with_interval
    from .page import report as report
    from .pages import diagnosis_page as diagnosis_page
    from .pages import fleet_page as fleet_page
    from .pages import identification_page as identification_page
    from .pages import signs_page as signs_page
    from .pages import validation_page as validation_page
    from .payload import payload_document as payload_document
    from .payload import payload_tables as payload_tables
    from .screen import Screen as Screen
    from .signs import signed_csv as signed_csv
    from .signs import signs_document as signs_document
    from .signs import signs_tables as signs_tables
    from .simulation import Run as Run
    from .simulation import simulation_document as simulation_document
    from .simulation import simulation_tables as simulation_tables
    from .tables import check_tables as check_tables
    from .tables import identification_tables as identification_tables
    from .tables import inspection_tables as inspection_tables
    from .validation import validation_document as validation_document
    from .validation import validation_tables as validation_tables
    from .write import Content as Content
    from .write import probe_folder as probe_folder
    from .write import write_files as write_files

NAMES = {
    "report.conversion": "conversion_document conversion_tables",
    "report.data": "data_card data_document data_tables",
    "report.diagnosis": "diagnosis_document",
    "report.diagnosis_tables": "diagnosis_tables",
    "report.documents": "check_document identification_document inspection_document to_json",
    "report.effects": "effects_document effects_tables",
    "report.factors": "factors_document factors_tables",
    "report.fleet": "fleet_tables",
    "report.motions": "excitation_document excitation_tables",
    "report.numbers": "figure with_interval",
    "report.page": "report",
    "report.pages": "diagnosis_page fleet_page identification_page signs_page validation_page",
    "report.payload": "payload_document payload_tables",
    "report.screen": "Screen",
    "report.signs": "signed_csv signs_document signs_tables",
    "report.simulation": "Run simulation_document simulation_tables",
    "report.tables": "check_tables identification_tables inspection_tables",
    "report.validation": "validation_document validation_tables",
    "report.write": "Content probe_folder write_files",
}

sys.modules[__name__].__class__ = _package(NAMES)
