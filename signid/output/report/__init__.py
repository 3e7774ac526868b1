"""Results as terminal tables, JSON documents and HTML pages; files are written atomically."""

import sys
from typing import TYPE_CHECKING

from ...registry import inner_package as _package, public_names as _names

if TYPE_CHECKING:
    from .documents import to_json as to_json
    from .layout import Screen as Screen, figure as figure, with_interval as with_interval
    from .page import report as report
    from .results.check.document import audit_document as audit_document, check_document as check_document
    from .results.check.page import audit_page as audit_page, check_page as check_page
    from .results.check.tables import audit_tables as audit_tables, check_tables as check_tables
    from .results.diagnosis import (
        diagnosis_document as diagnosis_document,
        diagnosis_page as diagnosis_page,
        diagnosis_tables as diagnosis_tables,
    )
    from .results.fleet import fleet_page as fleet_page, fleet_tables as fleet_tables
    from .results.identification import (
        identification_document as identification_document,
        identification_page as identification_page,
        identification_tables as identification_tables,
    )
    from .results.inspection import inspection_document as inspection_document, inspection_tables as inspection_tables
    from .results.laws import effects_document as effects_document, effects_tables as effects_tables
    from .results.payload import payload_document as payload_document, payload_tables as payload_tables
    from .results.recordings import (
        conversion_document as conversion_document,
        conversion_tables as conversion_tables,
        data_card as data_card,
        data_document as data_document,
        data_tables as data_tables,
        factors_document as factors_document,
        factors_tables as factors_tables,
    )
    from .results.servo_diagnosis import (
        servo_diagnosis_document as servo_diagnosis_document,
        servo_diagnosis_page as servo_diagnosis_page,
        servo_diagnosis_tables as servo_diagnosis_tables,
    )
    from .results.servo_identification import (
        servo_identification_document as servo_identification_document,
        servo_identification_tables as servo_identification_tables,
        servo_page as servo_page,
    )
    from .results.signs import (
        signed_csv as signed_csv,
        signs_document as signs_document,
        signs_page as signs_page,
        signs_tables as signs_tables,
    )
    from .results.simulation import (
        SimulationRun as SimulationRun,
        excitation_document as excitation_document,
        excitation_tables as excitation_tables,
        servo_simulation_document as servo_simulation_document,
        servo_simulation_tables as servo_simulation_tables,
        simulation_document as simulation_document,
        simulation_tables as simulation_tables,
    )
    from .results.validation import (
        servo_validation_document as servo_validation_document,
        servo_validation_page as servo_validation_page,
        servo_validation_tables as servo_validation_tables,
        validation_document as validation_document,
        validation_page as validation_page,
        validation_tables as validation_tables,
    )
    from .write import (
        WRITTEN as WRITTEN,
        Content as Content,
        check_foreign as check_foreign,
        probe_folder as probe_folder,
        write_files as write_files,
    )

NAMES = _names(__name__)

sys.modules[__name__].__class__ = _package(__name__, NAMES)
