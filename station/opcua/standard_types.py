"""What the server uses of the companion specifications, as facts: names, node ids, data types, modelling rules.

OPC 10000-100 Devices, OPC 40001-1 Machinery and OPC 40001-101 Result Transfer. A type has the members that are in use
here and the mandatory ones; structures, enumerations and state machines are whole.
"""

from __future__ import annotations

from datetime import UTC, datetime
from typing import NamedTuple

from asyncua import ua

BASE = "http://opcfoundation.org/UA/"
DI = "http://opcfoundation.org/UA/DI/"
MACHINERY = "http://opcfoundation.org/UA/Machinery/"
RESULT = "http://opcfoundation.org/UA/Machinery/Result/"

Ids = ua.ObjectIds
SCALAR, LIST = -1, 1
"""Value ranks."""


class Id(NamedTuple):
    """A node: the specification that it is of, and its number there."""

    space: str
    number: int


class Name(NamedTuple):
    """A browse name: the specification that gave it, and the name."""

    space: str
    name: str


def _base(number: int) -> Id:
    return Id(BASE, number)


def _di(number: int) -> Id:
    return Id(DI, number)


def _machinery(number: int) -> Id:
    return Id(MACHINERY, number)


def _result(number: int) -> Id:
    return Id(RESULT, number)


MANDATORY, OPTIONAL = _base(Ids.ModellingRule_Mandatory), _base(Ids.ModellingRule_Optional)
STRING, TEXT, QUALIFIED = _base(Ids.String), _base(Ids.LocalizedText), _base(Ids.QualifiedName)
ANY, INT32, BOOLEAN, IDENTIFIER = (
    _base(Ids.BaseDataType),
    _base(Ids.Int32),
    _base(Ids.Boolean),
    _base(Ids.TrimmedString),
)
UTC_TIME, DURATION, HANDLE = _base(Ids.UtcTime), _base(Ids.Duration), _base(Ids.Handle)
EVALUATION, TIMES, META, WHOLE = _result(3002), _result(3006), _result(3007), _result(3008)
"""Data types."""


class Model(NamedTuple):
    """A specification: the node that tells of it, and the numbers of its seven properties in the order of `TOLD`."""

    uri: str
    version: str
    published: datetime
    number: int
    properties: tuple[int, int, int, int, int, int, int]
    numbers: tuple[str, ...] = ()


TOLD: tuple[tuple[str, Id, int], ...] = (
    ("NamespaceUri", STRING, SCALAR),
    ("NamespaceVersion", STRING, SCALAR),
    ("NamespacePublicationDate", _base(Ids.DateTime), SCALAR),
    ("IsNamespaceSubset", BOOLEAN, SCALAR),
    ("StaticNodeIdTypes", _base(Ids.IdType), LIST),
    ("StaticNumericNodeIdRange", _base(Ids.NumericRange), LIST),
    ("StaticStringNodeIdPattern", STRING, SCALAR),
)
"""Properties of NamespaceMetadataType."""

MODELS: tuple[Model, ...] = (
    Model(
        DI, "1.04.0", datetime(2022, 11, 3, tzinfo=UTC), 15001, (15002, 15003, 15004, 15005, 15006, 15007, 15008),
        ("1:2147483647",),
    ),
    Model(MACHINERY, "1.03.0", datetime(2023, 8, 1, tzinfo=UTC), 5001, (6033, 6034, 6032, 6031, 6035, 6036, 6037)),
    Model(RESULT, "1.01.0", datetime(2025, 7, 1, tzinfo=UTC), 5007, (6004, 6005, 6003, 6002, 6006, 6007, 6008)),
)  # fmt: skip
"""In the order in which they build on each other, and in which they get their namespaces."""


class Type(NamedTuple):
    """An object type: what it is a subtype of, which interfaces it has, which events its objects send."""

    id: Id
    name: str
    above: Id
    abstract: bool = False
    interfaces: tuple[Id, ...] = ()
    events: tuple[Id, ...] = ()


INTERFACE, STATE_MACHINE = _base(Ids.BaseInterfaceType), _base(Ids.FiniteStateMachineType)

TYPES: tuple[Type, ...] = (
    Type(_di(1005), "FunctionalGroupType", _base(Ids.FolderType)),
    Type(_di(15035), "IVendorNameplateType", INTERFACE, abstract=True),
    Type(_di(15048), "ITagNameplateType", INTERFACE, abstract=True),
    Type(_machinery(1003), "IMachineryItemVendorNameplateType", _di(15035), abstract=True),
    Type(_machinery(1010), "IMachineVendorNameplateType", _machinery(1003), abstract=True),
    Type(_machinery(1011), "IMachineTagNameplateType", _di(15048), abstract=True),
    Type(
        _machinery(1004), "MachineryItemIdentificationType", _di(1005), abstract=True,
        interfaces=(_machinery(1003), _di(15048)),
    ),
    Type(
        _machinery(1012), "MachineIdentificationType", _machinery(1004),
        interfaces=(_machinery(1010), _machinery(1011)),
    ),
    Type(_machinery(1002), "MachineryItemState_StateMachineType", STATE_MACHINE),
    Type(_machinery(1008), "MachineryOperationModeStateMachineType", STATE_MACHINE),
    Type(_result(1002), "ResultReadyEventType", _base(Ids.BaseEventType), abstract=True),
    Type(_result(1004), "ResultManagementType", _base(Ids.BaseObjectType), events=(_result(1002),)),
)  # fmt: skip
"""A type stands below those that it names."""


class Property(NamedTuple):
    """A property of a type. rule: None where instances do not get it; value: that of the type itself."""

    id: Id
    of: Id
    name: Name
    data_type: Id
    rule: Id | None
    value: Name | None = None


_DEFAULT_NAME = Name(BASE, "DefaultInstanceBrowseName")
_IDENTIFICATION, _LOCATION = Name(DI, "Identification"), Name(MACHINERY, "Location")
_PRODUCT, _SERIAL = Name(DI, "ProductInstanceUri"), Name(DI, "SerialNumber")

PROPERTIES: tuple[Property, ...] = (
    Property(_di(15036), _di(15035), Name(DI, "Manufacturer"), TEXT, OPTIONAL),
    Property(_di(15038), _di(15035), Name(DI, "Model"), TEXT, OPTIONAL),
    Property(_di(15040), _di(15035), Name(DI, "SoftwareRevision"), STRING, OPTIONAL),
    Property(_di(15044), _di(15035), Name(DI, "DeviceClass"), STRING, OPTIONAL),
    Property(_di(15045), _di(15035), _SERIAL, STRING, OPTIONAL),
    Property(_di(15046), _di(15035), _PRODUCT, STRING, OPTIONAL),
    Property(_machinery(6022), _machinery(1003), Name(DI, "Manufacturer"), TEXT, MANDATORY),
    Property(_machinery(6024), _machinery(1003), _SERIAL, STRING, MANDATORY),
    Property(_machinery(6023), _machinery(1010), _PRODUCT, STRING, MANDATORY),
    Property(_machinery(6028), _machinery(1011), _LOCATION, STRING, OPTIONAL),
    Property(_machinery(6088), _machinery(1004), _DEFAULT_NAME, QUALIFIED, None, _IDENTIFICATION),
    Property(_machinery(6002), _machinery(1004), Name(DI, "Manufacturer"), TEXT, MANDATORY),
    Property(_machinery(6003), _machinery(1004), _SERIAL, STRING, MANDATORY),
    Property(_machinery(6001), _machinery(1004), _PRODUCT, STRING, OPTIONAL),
    Property(_machinery(6008), _machinery(1004), Name(DI, "Model"), TEXT, OPTIONAL),
    Property(_machinery(6011), _machinery(1004), Name(DI, "SoftwareRevision"), STRING, OPTIONAL),
    Property(_machinery(6012), _machinery(1004), Name(DI, "DeviceClass"), STRING, OPTIONAL),
    Property(_machinery(6030), _machinery(1012), _DEFAULT_NAME, QUALIFIED, None, _IDENTIFICATION),
    Property(_machinery(6015), _machinery(1012), _PRODUCT, STRING, MANDATORY),
    Property(_machinery(6029), _machinery(1012), _LOCATION, STRING, OPTIONAL),
    Property(_machinery(6021), _machinery(1002), _DEFAULT_NAME, QUALIFIED, None, Name(MACHINERY, "MachineryItemState")),
    Property(
        _machinery(6058), _machinery(1008), _DEFAULT_NAME, QUALIFIED, None, Name(MACHINERY, "MachineryOperationMode")
    ),
    Property(_result(6037), _result(1004), _DEFAULT_NAME, QUALIFIED, None, Name(RESULT, "ResultManagement")),
)


class State(NamedTuple):
    """A state. number: that of its node; value: its StateNumber."""

    number: int
    value: int
    name: str


class Change(NamedTuple):
    """A transition between two states. number: that of its node; value: its TransitionNumber."""

    number: int
    value: int
    source: str
    target: str


class StateMachine(NamedTuple):
    """States and transitions of a type. The node of StateNumber or TransitionNumber is so much above its owner's."""

    of: Id
    above: int
    states: tuple[State, ...]
    changes: tuple[Change, ...]


STATE_MACHINES: tuple[StateMachine, ...] = (
    StateMachine(
        _machinery(1002), 1034,
        (
            State(5005, 0, "NotAvailable"), State(5004, 1, "OutOfService"),
            State(5007, 2, "NotExecuting"), State(5006, 3, "Executing"),
        ),
        (
            Change(5008, 0, "NotAvailable", "OutOfService"), Change(5009, 2, "NotAvailable", "NotExecuting"),
            Change(5010, 1, "NotAvailable", "Executing"), Change(5011, 12, "NotAvailable", "NotAvailable"),
            Change(5012, 3, "OutOfService", "NotAvailable"), Change(5013, 5, "OutOfService", "NotExecuting"),
            Change(5014, 4, "OutOfService", "Executing"), Change(5015, 13, "OutOfService", "OutOfService"),
            Change(5016, 9, "NotExecuting", "NotAvailable"), Change(5017, 10, "NotExecuting", "OutOfService"),
            Change(5018, 11, "NotExecuting", "Executing"), Change(5019, 15, "NotExecuting", "NotExecuting"),
            Change(5020, 6, "Executing", "NotAvailable"), Change(5021, 7, "Executing", "OutOfService"),
            Change(5022, 8, "Executing", "NotExecuting"), Change(5023, 14, "Executing", "Executing"),
        ),
    ),
    StateMachine(
        _machinery(1008), 1035,
        (
            State(5024, 0, "None"), State(5025, 1, "Maintenance"),
            State(5027, 2, "Setup"), State(5026, 3, "Processing"),
        ),
        (
            Change(5028, 0, "None", "Maintenance"), Change(5029, 2, "None", "Setup"),
            Change(5030, 1, "None", "Processing"), Change(5031, 12, "None", "None"),
            Change(5032, 3, "Maintenance", "None"), Change(5033, 5, "Maintenance", "Setup"),
            Change(5034, 4, "Maintenance", "Processing"), Change(5035, 13, "Maintenance", "Maintenance"),
            Change(5036, 9, "Setup", "None"), Change(5037, 10, "Setup", "Maintenance"),
            Change(5038, 11, "Setup", "Processing"), Change(5039, 15, "Setup", "Setup"),
            Change(5040, 6, "Processing", "None"), Change(5041, 7, "Processing", "Maintenance"),
            Change(5042, 8, "Processing", "Setup"), Change(5043, 14, "Processing", "Processing"),
        ),
    ),
)  # fmt: skip


class Enumeration(NamedTuple):
    """An enumeration; its values count from 0. values: number of its property EnumValues."""

    id: Id
    name: str
    values: int
    names: tuple[str, ...]


ENUMERATIONS: tuple[Enumeration, ...] = (
    Enumeration(EVALUATION, "ResultEvaluationEnum", 6001, ("Undefined", "OK", "NotOK", "NotDecidable")),
)


class Field(NamedTuple):
    """A field of a structure, or an argument of a method."""

    name: str
    data_type: Id
    rank: int = SCALAR
    optional: bool = False


class Structure(NamedTuple):
    """A structure with its own fields. binary: number of its binary encoding; None where it is abstract."""

    id: Id
    name: str
    above: Id
    binary: int | None
    fields: tuple[Field, ...]


STRUCTURES: tuple[Structure, ...] = (
    Structure(
        _result(3005), "BaseResultTransferOptionsDataType", _base(Ids.Structure), None,
        (Field("ResultId", IDENTIFIER),),
    ),
    Structure(_result(3004), "ResultTransferOptionsDataType", _result(3005), 5001, ()),
    Structure(
        TIMES, "ProcessingTimesDataType", _base(Ids.Structure), 5003,
        (
            Field("StartTime", UTC_TIME),
            Field("EndTime", UTC_TIME),
            Field("AcquisitionDuration", DURATION, optional=True),
            Field("ProcessingDuration", DURATION, optional=True),
        ),
    ),
    Structure(
        META, "ResultMetaDataType", _base(Ids.Structure), 5005,
        (
            Field("ResultId", IDENTIFIER), Field("HasTransferableDataOnFile", BOOLEAN, optional=True),
            Field("IsPartial", BOOLEAN, optional=True), Field("IsSimulated", BOOLEAN, optional=True),
            Field("ResultState", INT32, optional=True), Field("StepId", IDENTIFIER, optional=True),
            Field("PartId", IDENTIFIER, optional=True), Field("ExternalRecipeId", IDENTIFIER, optional=True),
            Field("InternalRecipeId", IDENTIFIER, optional=True), Field("ProductId", IDENTIFIER, optional=True),
            Field("ExternalConfigurationId", IDENTIFIER, optional=True),
            Field("InternalConfigurationId", IDENTIFIER, optional=True), Field("JobId", IDENTIFIER, optional=True),
            Field("CreationTime", UTC_TIME, optional=True), Field("ProcessingTimes", TIMES, optional=True),
            Field("ResultUri", _base(Ids.UriString), LIST, optional=True),
            Field("ResultEvaluation", EVALUATION, optional=True),
            Field("ResultEvaluationCode", _base(Ids.Int64), optional=True),
            Field("ResultEvaluationDetails", TEXT, optional=True), Field("FileFormat", STRING, LIST, optional=True),
        ),
    ),
    # The standard lets the meta data be of a subtype (AllowSubTypes), and sends it with its own type then. asyncua 2.1
    # can neither send nor read that: this definition says what is sent, the meta data itself.
    Structure(
        WHOLE, "ResultDataType", _base(Ids.Structure), 5008,
        (Field("ResultMetaData", META), Field("ResultContent", ANY, LIST)),
    ),
)  # fmt: skip
"""A structure stands below those that it names."""

RESULT_TYPE = Type(_result(2001), "ResultType", _base(Ids.BaseDataVariableType))
"""The variable type of a result; its data type is `WHOLE`."""


class Variable(NamedTuple):
    """A variable within a type. by: the reference that holds it; of_type: its type definition."""

    id: Id
    of: Id
    by: int
    name: str
    data_type: Id
    rank: int = SCALAR
    rule: Id = MANDATORY
    of_type: Id = _base(Ids.BaseDataVariableType)


VARIABLES: tuple[Variable, ...] = (
    Variable(_result(6010), _result(2001), Ids.HasStructuredComponent, "ResultContent", ANY, LIST, OPTIONAL),
    Variable(_result(6009), _result(2001), Ids.HasStructuredComponent, "ResultMetaData", META),
    Variable(_result(6032), _result(1002), Ids.HasComponent, "Result", WHOLE, of_type=_result(2001)),
    Variable(_result(6033), _result(6032), Ids.HasStructuredComponent, "ResultMetaData", META),
)

PARTS: dict[str, tuple[int, int]] = {
    "ResultId": (6012, 6034), "IsPartial": (6014, 6063),
    "IsSimulated": (6015, 6064), "ResultState": (6016, 6072),
    "PartId": (6018, 6066), "ExternalRecipeId": (6019, 6058),
    "InternalRecipeId": (6020, 6062), "ProductId": (6021, 6068),
    "InternalConfigurationId": (6023, 6061), "CreationTime": (6025, 6056),
    "ProcessingTimes": (6026, 6067), "ResultEvaluation": (6028, 6069),
    "ResultEvaluationDetails": (6029, 6071), "FileFormat": (6031, 6059),
}  # fmt: skip
"""Fields of the meta data that are variables too: number below ResultType, number below the event."""


class Method(NamedTuple):
    """A method of ResultManagementType. inputs, outputs: number of the node, and the arguments."""

    number: int
    name: str
    inputs: tuple[int, tuple[Field, ...]]
    outputs: tuple[int, tuple[Field, ...]]


_TIMEOUT, _ERROR, _HANDLE = Field("Timeout", INT32), Field("Error", INT32), Field("ResultHandle", HANDLE)
_ONE = (_HANDLE, Field("Result", WHOLE), _ERROR)

METHODS: tuple[Method, ...] = (
    Method(7005, "GetResultById", (6048, (Field("ResultId", IDENTIFIER), _TIMEOUT)), (6049, _ONE)),
    Method(
        7006, "GetResultIdListFiltered",
        (6050, (
            Field("Filter", _base(Ids.ContentFilter)), Field("OrderedBy", _base(Ids.RelativePath), LIST),
            Field("MaxResults", _base(Ids.UInt32)), _TIMEOUT,
        )),
        (6051, (_HANDLE, Field("ResultIdList", IDENTIFIER, LIST), _ERROR)),
    ),
    Method(7007, "ReleaseResultHandle", (6052, (_HANDLE,)), (6053, (_ERROR,))),
    Method(7008, "GetLatestResult", (6054, (_TIMEOUT,)), (6055, _ONE)),
    Method(
        7009, "AcknowledgeResults", (6089, (Field("ResultIds", IDENTIFIER, LIST),)),
        (6090, (Field("ErrorPerResultId", INT32, LIST), _ERROR)),
    ),
)  # fmt: skip

MACHINES = _machinery(1001)
"""The folder of all machines, below Objects."""
