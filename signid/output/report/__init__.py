"""What is found, in words and numbers: tables for the eye, JSON for programs, files that are never half-written."""

import sys
from typing import TYPE_CHECKING

from ...registry import inner_package as _package

if TYPE_CHECKING:
    from .diagnosis.document import diagnosis_document as diagnosis_document
    from .diagnosis.tables import diagnosis_tables as diagnosis_tables
    from .numbers import figure as figure
    from .numbers import with_interval as with_interval
    from .page import report as report
    from .pages import diagnosis_page as diagnosis_page
    from .pages import fleet_page as fleet_page
    from .pages import identification_page as identification_page
    from .pages import signs_page as signs_page
    from .pages import validation_page as validation_page
    from .results.conversion import conversion_document as conversion_document
    from .results.conversion import conversion_tables as conversion_tables
    from .results.data import data_card as data_card
    from .results.data import data_document as data_document
    from .results.data import data_tables as data_tables
    from .results.documents import check_document as check_document
    from .results.documents import identification_document as identification_document
    from .results.documents import inspection_document as inspection_document
    from .results.documents import to_json as to_json
    from .results.effects import effects_document as effects_document
    from .results.effects import effects_tables as effects_tables
    from .results.excitation import excitation_document as excitation_document
    from .results.excitation import excitation_tables as excitation_tables
    from .results.factors import factors_document as factors_document
    from .results.factors import factors_tables as factors_tables
    from .results.fleet import fleet_tables as fleet_tables
    from .results.payload import payload_document as payload_document
    from .results.payload import payload_tables as payload_tables
    from .results.signs import signed_csv as signed_csv
    from .results.signs import signs_document as signs_document
    from .results.signs import signs_tables as signs_tables
    from .results.simulation import Run as Run
    from .results.simulation import simulation_document as simulation_document
    from .results.simulation import simulation_tables as simulation_tables
    from .results.tables import check_tables as check_tables
    from .results.tables import identification_tables as identification_tables
    from .results.tables import inspection_tables as inspection_tables
    from .results.validation import validation_document as validation_document
    from .results.validation import validation_tables as validation_tables
    from .screen import Screen as Screen
    from .write import Content as Content
    from .write import probe_folder as probe_folder
    from .write import write_files as write_files

NAMES = {
    "output.report.results.conversion": "conversion_document conversion_tables",
    "output.report.results.data": "data_card data_document data_tables",
    "output.report.diagnosis.document": "diagnosis_document",
    "output.report.diagnosis.tables": "diagnosis_tables",
    "output.report.results.documents": "check_document identification_document inspection_document to_json",
    "output.report.results.effects": "effects_document effects_tables",
    "output.report.results.factors": "factors_document factors_tables",
    "output.report.results.fleet": "fleet_tables",
    "output.report.results.excitation": "excitation_document excitation_tables",
    "output.report.numbers": "figure with_interval",
    "output.report.page": "report",
    "output.report.pages": "diagnosis_page fleet_page identification_page signs_page validation_page",
    "output.report.results.payload": "payload_document payload_tables",
    "output.report.screen": "Screen",
    "output.report.results.signs": "signed_csv signs_document signs_tables",
    "output.report.results.simulation": "Run simulation_document simulation_tables",
    "output.report.results.tables": "check_tables identification_tables inspection_tables",
    "output.report.results.validation": "validation_document validation_tables",
    "output.report.write": "Content probe_folder write_files",
}

sys.modules[__name__].__class__ = _package(NAMES)
