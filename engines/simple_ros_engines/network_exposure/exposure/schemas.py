"""What requests, answers and notifications must have at least: our own short schemas. Pure.

Written from the field lists of TS 29.549, TS 29.122, TS 29.571, RFC 6749, RFC 7807 and CAMARA Quality-on-Demand. What
we send and what comes is checked against them always; tests check the same against the official files.
"""

from __future__ import annotations

from typing import Any

from simple_ros_engines.network_exposure.exposure.schema import Schema

__all__ = [
    "AS_SESSION",
    "AS_SESSIONS",
    "CREATE_SESSION",
    "EXTEND_SESSION",
    "GROUP",
    "GROUP_PATCH",
    "MONITORING_REPORT",
    "MONITORING_SUBSCRIPTION",
    "PROBLEM",
    "QOS_STATUS_CHANGED",
    "SESSION_INFO",
    "TOKEN",
    "UNICAST_SUBSCRIPTION",
    "UNIQUE_QOS",
    "UP_NOTIFICATION",
    "USER_PLANE_NOTIFICATION",
]

STRING: Schema = {"type": "string"}
TEXT: Schema = {"type": "string", "minLength": 1}
COUNT: Schema = {"type": "integer", "minimum": 0}
BOOLEAN: Schema = {"type": "boolean"}
URI: Schema = {"type": "string", "pattern": r"^[A-Za-z][A-Za-z0-9+.-]*://.+"}
HTTPS_URI: Schema = {"type": "string", "pattern": r"^https://.+$"}
STAMP: Schema = {
    "type": "string",
    "pattern": r"^\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d(\.\d+)?(Z|[+-]\d\d:\d\d)$",
}
FEATURES: Schema = {"type": "string", "pattern": r"^[A-Fa-f0-9]*$"}
BIT_RATE: Schema = {"type": "string", "pattern": r"^\d+(\.\d+)? (bps|Kbps|Mbps|Gbps|Tbps)$"}
IPV4: Schema = {"type": "string", "pattern": r"^\d{1,3}(\.\d{1,3}){3}$"}
PORT: Schema = {"type": "integer", "minimum": 0, "maximum": 65535}


def _object(required: str = "", **properties: Schema) -> dict[str, Any]:
    return {"type": "object", "required": tuple(required.split()), "properties": properties}


def _list(items: Schema, least: int = 1) -> dict[str, Any]:
    return {"type": "array", "minItems": least, "items": items}


def _one_of(names: str) -> dict[str, Any]:
    return {"oneOf": tuple({"required": (name,)} for name in names.split())}


TOKEN = _object(
    "access_token token_type",
    access_token=TEXT,
    token_type=TEXT,
    expires_in={"type": "integer", "minimum": 1},
    scope=STRING,
)
PROBLEM = _object(title=STRING, status=COUNT, detail=STRING, cause=STRING, type=STRING)

# -- SEAL, TS 29.549 -----------------------------------------------------------------------------

VAL_TARGET = {**_object(valUserId=TEXT, valUeId=TEXT), **_one_of("valUserId valUeId")}
GROUP = _object(
    "valGroupId",
    valGroupId=TEXT,
    grpDesc=STRING,
    members=_list(VAL_TARGET),
    valGrpConf=STRING,
    valServiceIds=_list(TEXT),
    suppFeat=FEATURES,
    resUri=URI,
    com5GLanType={"enum": ("IPV4", "IPV6", "IPV4V6", "UNSTRUCTURED", "ETHERNET")},
)
GROUP_PATCH = _object("members", members=_list(VAL_TARGET))
UNICAST_SUBSCRIPTION = _object(
    "valTgtUe notifUri",
    valTgtUe=VAL_TARGET,
    uniQosReq=STRING,
    duration=STAMP,
    notifUri=URI,
    reqTestNotif=BOOLEAN,
    suppFeat=FEATURES,
)
UNIQUE_QOS = _object(
    "5qi flowDescriptions",
    **{"5qi": {"type": "integer", "minimum": 0, "maximum": 255}},
    alternatives=_list({"type": "integer"}, 0),
    flowDescriptions=_list(TEXT),
    gbrUl=BIT_RATE,
    gbrDl=BIT_RATE,
    pdb={"type": "integer", "minimum": 1},
    per={"type": "string", "pattern": r"^[0-9]E-[0-9]$"},
    maxBurst={"type": "integer", "minimum": 1},
)
MEASUREMENT = {
    **_object(
        dlDelay=COUNT,
        ulDelay=COUNT,
        rtDelay=COUNT,
        avgPlr={"type": "integer", "minimum": 0, "maximum": 1000},
        avgDataRate=BIT_RATE,
        maxDataRate=BIT_RATE,
        avrDlTrafficVol=COUNT,
        avrUlTrafficVol=COUNT,
    ),
    "minProperties": 1,
}
MONITORING_REPORT = _object(
    "measData timestamp",
    measData=MEASUREMENT,
    timestamp=STAMP,
    valUeIds=_list(VAL_TARGET),
    valGroupId=TEXT,
    valStreamIds=_list(TEXT),
)
UP_NOTIFICATION = _object(
    "notifId eventNotifs",
    notifId=TEXT,
    eventNotifs=_list(_object("event ts", event=TEXT, ts=STAMP, deliveryMode=TEXT)),
)
_MEASURED = (
    "DL_DELAY", "UL_DELAY", "RT_DELAY", "AVG_PLR", "AVG_DATA_RATE", "MAX_DATA_RATE",
    "AVG_DL_TRAFFIC_VOLUME", "AVG_UL_TRAFFIC_VOLUME",
)  # fmt: skip
MONITORING_SUBSCRIPTION = {
    **_object(
        "",
        valUeIds=_list(VAL_TARGET),
        valGroupId=TEXT,
        valStreamIds=_list(TEXT),
        measReqs=_object("measDataTypes", measDataTypes=_list({"enum": _MEASURED})),
        reportReqs=_object(
            "reportingMode",
            reportingMode={"enum": ("PERIODIC", "ONE_TIME", "ON_EVENT_DETECTION")},
            reportingPeriod=COUNT,
            reportingThrs=_list(
                _object(
                    "measThrValues thrDirection",
                    measThrValues=MEASUREMENT,
                    thrDirection={"enum": ("ASCENDING", "DESCENDING", "CROSSED")},
                )
            ),
            immRep=BOOLEAN,
        ),
        notifUri=URI,
        suppFeat=FEATURES,
    ),
    **_one_of("valUeIds valGroupId valStreamIds"),
}

# -- NEF AsSessionWithQoS, TS 29.122 -------------------------------------------------------------

FLOW_INFO = _object(
    "flowId",
    flowId={"type": "integer"},
    flowDescriptions={**_list(TEXT), "maxItems": 2},
)
AS_SESSION = _object(
    "notificationDestination",
    self=URI,
    notificationDestination=URI,
    supportedFeatures=FEATURES,
    ueIpv4Addr=IPV4,
    ueIpv6Addr=STRING,
    gpsi=TEXT,
    flowInfo=_list(FLOW_INFO),
    qosReference=TEXT,
    altQoSReferences=_list(TEXT),
    events=_list(TEXT),
    qosMonInfo=_object(
        "reqQosMonParams repFreqs", reqQosMonParams=_list(TEXT), repFreqs=_list(TEXT)
    ),
    qosDuration=COUNT,
    tscQosReq=_object(reqGbrUl=BIT_RATE, reqGbrDl=BIT_RATE),
)
AS_SESSIONS = _list(AS_SESSION, 0)
USER_PLANE_NOTIFICATION = _object(
    "transaction eventReports",
    transaction=URI,
    eventReports=_list(
        _object(
            "event",
            event=TEXT,
            flowIds=_list({"type": "integer"}),
            appliedQosRef=STRING,
            qosMonReports=_list(
                _object(
                    ulDelays=_list(COUNT),
                    dlDelays=_list(COUNT),
                    rtDelays=_list(COUNT),
                    ulDataRate=BIT_RATE,
                    dlDataRate=BIT_RATE,
                )
            ),
        )
    ),
)

# -- CAMARA Quality-on-Demand --------------------------------------------------------------------

_PORTS = {
    **_object(ports=_list(PORT), ranges=_list(_object("from to", **{"from": PORT, "to": PORT}))),
    "minProperties": 1,
}
_DEVICE = {
    **_object(
        phoneNumber={"type": "string", "pattern": r"^\+[1-9][0-9]{4,14}$"},
        networkAccessIdentifier=TEXT,
        ipv4Address={
            **_object("publicAddress", publicAddress=IPV4, privateAddress=IPV4, publicPort=PORT),
            "anyOf": ({"required": ("privateAddress",)}, {"required": ("publicPort",)}),
        },
        ipv6Address=TEXT,
    ),
    "minProperties": 1,
}
_SERVER = {
    **_object(ipv4Address=TEXT, ipv6Address=TEXT, ipAddresses=_list(TEXT)),
    "minProperties": 1,
}
_PROFILE: Schema = {"type": "string", "minLength": 3, "pattern": r"^[a-zA-Z0-9_.-]+$"}
_SECONDS: Schema = {"type": "integer", "minimum": 1}
_SESSION: dict[str, Schema] = {
    "device": _DEVICE,
    "applicationServer": _SERVER,
    "devicePorts": _PORTS,
    "applicationServerPorts": _PORTS,
    "qosProfile": _PROFILE,
    "duration": _SECONDS,
    "sink": HTTPS_URI,
}
CREATE_SESSION = _object(
    "applicationServer qosProfile duration",
    **_SESSION,
    sinkCredential=_object(
        "credentialType", credentialType=TEXT, accessToken=TEXT, accessTokenExpiresUtc=STAMP
    ),
)
_STATUS_INFO: Schema = {"enum": ("DURATION_EXPIRED", "NETWORK_TERMINATED", "DELETE_REQUESTED")}
SESSION_INFO = _object(
    "sessionId duration qosStatus applicationServer qosProfile",
    **_SESSION,
    sessionId=TEXT,
    startedAt=STAMP,
    expiresAt=STAMP,
    qosStatus={"enum": ("REQUESTED", "AVAILABLE", "UNAVAILABLE")},
    statusInfo=_STATUS_INFO,
)
EXTEND_SESSION = _object("requestedAdditionalDuration", requestedAdditionalDuration=_SECONDS)
QOS_STATUS_CHANGED = _object(
    "id source specversion type time data",
    id=TEXT,
    source=TEXT,
    specversion={"enum": ("1.0",)},
    type={"enum": ("org.camaraproject.quality-on-demand.v1.qos-status-changed",)},
    time=STAMP,
    datacontenttype={"enum": ("application/json",)},
    data=_object(
        "sessionId qosStatus",
        sessionId=TEXT,
        qosStatus={"enum": ("AVAILABLE", "UNAVAILABLE")},
        statusInfo=_STATUS_INFO,
    ),
)
