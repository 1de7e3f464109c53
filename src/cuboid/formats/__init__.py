"""Validation of each file format: what is read is checked here, once, against the one description of its format.

`reading` opens files (regular ones only, of a bounded size); `json_door` and `table_door` check what is in them against
the descriptions in the other modules, from which ``docs/formats.md`` and the JSON Schemas are made as well. What has
passed is not checked again.
"""
