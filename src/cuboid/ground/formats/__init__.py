"""Validation of file formats: every input is checked once, against the single description of its format.

`reading` opens files (regular ones only, of a bounded size); `json_validation` and `table_validation` check what is in
them against the descriptions in the other modules, from which the pages of formats and JSON Schemas are made as well.
Validated data is not checked again.
"""
