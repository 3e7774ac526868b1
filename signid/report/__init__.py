"""What is found, in words and numbers: tables for the eye, JSON for programs, files that are never half-written."""

from .conversion import conversion_document, conversion_tables
from .data import data_card, data_document, data_tables
from .diagnosis import diagnosis_document
from .diagnosis_tables import diagnosis_tables
from .documents import check_document, identification_document, inspection_document, to_json
from .effects import effects_document, effects_tables
from .factors import factors_document, factors_tables
from .fleet import fleet_tables
from .motions import excitation_document, excitation_tables
from .numbers import figure, with_interval
from .page import report
from .pages import diagnosis_page, fleet_page, identification_page, signs_page
from .payload import payload_document, payload_tables
from .screen import Screen
from .signs import signed_csv, signs_document, signs_tables
from .simulation import Run, simulation_document, simulation_tables
from .tables import check_tables, identification_tables, inspection_tables
from .write import Content, probe_folder, write_files

__all__ = [
    "Content",
    "Run",
    "Screen",
    "check_document",
    "check_tables",
    "conversion_document",
    "conversion_tables",
    "data_card",
    "data_document",
    "data_tables",
    "diagnosis_document",
    "diagnosis_page",
    "diagnosis_tables",
    "effects_document",
    "effects_tables",
    "excitation_document",
    "excitation_tables",
    "factors_document",
    "factors_tables",
    "figure",
    "fleet_page",
    "fleet_tables",
    "identification_document",
    "identification_page",
    "identification_tables",
    "inspection_document",
    "inspection_tables",
    "payload_document",
    "payload_tables",
    "probe_folder",
    "report",
    "signed_csv",
    "signs_document",
    "signs_page",
    "signs_tables",
    "simulation_document",
    "simulation_tables",
    "to_json",
    "with_interval",
    "write_files",
]
