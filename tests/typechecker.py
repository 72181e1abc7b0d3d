"""beartype as the tests use it: a whole number may stand where a float is asked for (PEP 484)."""

from beartype import BeartypeConf, beartype

CONF = BeartypeConf(is_pep484_tower=True, claw_is_pep526=False)  # functions and classes, not assignments
check = beartype(conf=CONF)
