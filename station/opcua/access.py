"""Who may enter and what a session may do: trusted applications, accounts of the station, and nothing to be written.

asyncua looks at the certificate that a client names in CreateSession, and lets a channel without security through to
the session. Here the certificate of the channel itself is what counts, and there is no session without one.
"""

from __future__ import annotations

import secrets
import sys
from collections.abc import Awaitable, Callable
from contextvars import ContextVar
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from asyncua import ua
from asyncua.common.utils import ServiceError
from asyncua.crypto.permission_rules import SimpleRoleRuleset, User, UserRole
from asyncua.server.internal_server import InternalServer
from asyncua.server.internal_session import InternalSession, SessionState
from asyncua.server.user_managers import UserManager
from cryptography import x509
from sqlalchemy import select

from station.errors import StationError
from station.opcua.certificates import OUT_OF_DATE, Trust, fingerprint, read_certificate
from station.opcua.settings import FILE, OpcUaSettings
from station.web.people.accounts import EntryRefusedError, TooManyEntriesError, enter, leave
from station.web.people.database import PEOPLE, StationDatabase

_Ids = ua.ObjectIds
ALLOWED = frozenset(
    ua.NodeId(number)
    for number in (
        _Ids.ReadRequest_Encoding_DefaultBinary,
        _Ids.BrowseRequest_Encoding_DefaultBinary,
        _Ids.BrowseNextRequest_Encoding_DefaultBinary,
        _Ids.TranslateBrowsePathsToNodeIdsRequest_Encoding_DefaultBinary,
        _Ids.RegisterNodesRequest_Encoding_DefaultBinary,
        _Ids.UnregisterNodesRequest_Encoding_DefaultBinary,
        _Ids.CallRequest_Encoding_DefaultBinary,
        _Ids.CreateSubscriptionRequest_Encoding_DefaultBinary,
        _Ids.ModifySubscriptionRequest_Encoding_DefaultBinary,
        _Ids.DeleteSubscriptionsRequest_Encoding_DefaultBinary,
        _Ids.SetPublishingModeRequest_Encoding_DefaultBinary,
        _Ids.CreateMonitoredItemsRequest_Encoding_DefaultBinary,
        _Ids.ModifyMonitoredItemsRequest_Encoding_DefaultBinary,
        _Ids.DeleteMonitoredItemsRequest_Encoding_DefaultBinary,
        _Ids.SetMonitoringModeRequest_Encoding_DefaultBinary,
        _Ids.PublishRequest_Encoding_DefaultBinary,
        _Ids.RepublishRequest_Encoding_DefaultBinary,
        _Ids.CloseSecureChannelRequest_Encoding_DefaultBinary,
    )
)
"""Requests within a session. All others are refused, and among them is each that writes, adds or removes."""


@dataclass
class Guest(User):
    """Who a session is of: an account, or the certificate of a client. client: whose results it is owed, '' for none.

    peer: fingerprint of the certificate of its application. account: the account that it entered by, '' for none.
    """

    client: str = ""
    peer: str = ""
    account: str = ""


CALLER: ContextVar[Guest] = ContextVar("caller")
"""Whose method is being called."""


def tell(text: str) -> None:
    """Say what happened, for the log of the service."""
    sys.stderr.write(f"opcua    {text}\n")


class ReadOnlyRules(SimpleRoleRuleset):
    """What a session may ask for."""

    def check_validity(self, user: User, action_type_id: ua.NodeId, body: object) -> bool:
        """Say whether a request is allowed."""
        del body
        return isinstance(user, Guest) and action_type_id in ALLOWED


class Doorkeeper(UserManager):
    """Lets in accounts of the station, users by certificate, and, where that is set, trusted applications alone."""

    def __init__(self, data: Path, settings: OpcUaSettings, database: StationDatabase) -> None:
        """Prepare it.

        Raises:
            StationError: the certificate of a client cannot be read, or its account is not known.

        """
        self._database, self._anonymous = database, settings.anonymous
        self._by_user = {client.user: client.name for client in settings.clients if client.user is not None}
        self._by_certificate = {
            fingerprint(read_certificate(data / client.certificate)): client.name
            for client in settings.clients
            if client.certificate is not None
        }
        with database.reading() as connection:
            known = set(connection.execute(select(PEOPLE.c.name)).scalars())
        unknown = sorted(set(self._by_user) - known)
        if unknown:
            raise StationError(
                f"{FILE}: clients: there is no account {unknown[0]!r}. Add it on the page People, with the role mes"
            )

    @property
    def tokens(self) -> list[type]:
        """Kinds of identity that a client may show."""
        kinds = [ua.UserNameIdentityToken, ua.X509IdentityToken]
        return [*kinds, ua.AnonymousIdentityToken] if self._anonymous else kinds

    def get_user(
        self, iserver: InternalServer, username: str | None = None, password: str | None = None,
        certificate: bytes | None = None,
    ) -> User | None:  # fmt: skip
        """Return who enters, None where nobody does."""
        del iserver
        if username is not None:
            return self._account(username, password or "")
        name = "" if certificate is None else self._by_certificate.get(_fingerprint(certificate), "")
        if name:
            return Guest(UserRole.User, f"client {name}", client=name)
        return Guest(UserRole.User, "anonymous") if self._anonymous else None

    def _account(self, name: str, password: str) -> Guest | None:
        try:
            entered = enter(self._database, name, password)
        except (TooManyEntriesError, StationError) as error:
            entered = EntryRefusedError(str(error))
        if isinstance(entered, EntryRefusedError):
            tell(f"account {name[:64]!r} refused: {entered}")
            return None
        with self._database.writing() as connection:
            leave(connection, entered.token)  # the session is this server's, not one of the pages
        if entered.person.must_change:
            tell(f"account {name!r} refused: has its first password. Change it at the station")
            return None
        return Guest(UserRole.User, name, client=self._by_user.get(name, ""), account=name)

    def closed(self, account: str) -> bool:
        """Say whether an account was closed or given another first password since it entered."""
        with self._database.reading() as connection:
            row = connection.execute(select(PEOPLE).where(PEOPLE.c.name == account)).first()
        return row is None or bool(row.disabled) or bool(row.must_change)


def _fingerprint(content: bytes) -> str:
    return fingerprint(x509.load_der_x509_certificate(content))


Watch = Callable[[Guest, int, list[tuple[int, ua.NodeId]]], None]
"""Is told whose subscription got items that wait for events: identifier of the subscription, items with their nodes."""


def refuse_untrusted(trust: Trust, certificate: x509.Certificate) -> None:
    """Refuse the application of a client whose certificate is not trusted; ServiceError as OPC UA names it."""
    problem = trust.problem_of(certificate)
    if problem:
        tell(f"application {certificate.subject.rfc4514_string()[:120]!r} refused: {problem}")
        expired, codes = problem.startswith(OUT_OF_DATE), ua.StatusCodes
        raise ServiceError(codes.BadCertificateTimeInvalid if expired else codes.BadCertificateUntrusted)


class StationSession(InternalSession):
    """A session of a client."""

    user: User
    trust: Trust
    watch: Watch

    def activate_session(
        self, params: ua.ActivateSessionParameters, peer_certificate: bytes | None
    ) -> ua.ActivateSessionResult:
        """Activate it for the user that the client shows, if the application of the client is trusted."""
        if not peer_certificate:
            raise ServiceError(ua.StatusCodes.BadSecurityPolicyRejected)
        refuse_untrusted(self.trust, x509.load_der_x509_certificate(peer_certificate))
        peer, before = _fingerprint(peer_certificate), self.user
        again = self.state is SessionState.Activated
        if again and (not isinstance(before, Guest) or before.peer != peer):
            raise ServiceError(ua.StatusCodes.BadSecurityChecksFailed)
        result = super().activate_session(params, peer_certificate)
        user = self.user
        if not isinstance(user, Guest) or (again and isinstance(before, Guest) and user.name != before.name):
            self.user = before
            raise ServiceError(ua.StatusCodes.BadIdentityChangeNotSupported)
        user.peer = peer
        return result

    async def create_session(
        self, params: ua.CreateSessionParameters, sockname: tuple[str, int] | None = None
    ) -> ua.CreateSessionResult:
        """Create it, under a token that nobody can guess."""
        self.iserver.unregister_external_session(self)
        self.auth_token = ua.NodeId(secrets.token_bytes(32), 0, ua.NodeIdType.ByteString)
        self.iserver.register_external_session(self)
        return await super().create_session(params, sockname)

    async def call(self, params: list[ua.CallMethodRequest]) -> list[ua.CallMethodResult]:
        """Call methods, each of which knows its caller."""
        if isinstance(self.user, Guest):
            CALLER.set(self.user)
        results: list[ua.CallMethodResult] = await super().call(params)
        return results

    async def create_monitored_items(
        self, params: ua.CreateMonitoredItemsParameters
    ) -> list[ua.MonitoredItemCreateResult]:
        """Watch nodes; who waits for events is told of by whoever sends them."""
        results: list[ua.MonitoredItemCreateResult] = await super().create_monitored_items(params)
        events = [
            (made.MonitoredItemId, item.ItemToMonitor.NodeId)
            for item, made in zip(params.ItemsToCreate, results, strict=True)
            if item.ItemToMonitor.AttributeId == ua.AttributeIds.EventNotifier and made.StatusCode.is_good()
        ]
        if events and isinstance(self.user, Guest):
            self.watch(self.user, params.SubscriptionId, events)
        return results


class StationServer(InternalServer):
    """asyncua's server with sessions of our own; it is no directory of other servers."""

    def __init__(self, doorkeeper: Doorkeeper, trust: Trust, watch: Watch) -> None:
        """Prepare it."""
        super().__init__(user_manager=doorkeeper)
        self.allow_remote_admin = False
        self.supported_tokens = tuple(doorkeeper.tokens)
        self.max_connections = 100
        self.max_subscriptions = 200
        self._trust, self._watch = trust, watch

        async def validate(certificate: x509.Certificate, description: ua.ApplicationDescription) -> None:
            del description
            refuse_untrusted(trust, certificate)

        self.certificate_validator: Callable[..., Awaitable[None]] = validate

    def create_session(self, name: str, user: User | None = None, external: bool = False) -> InternalSession:  # noqa: FBT001, FBT002 - asyncua's own signature
        """Return a new session."""
        kind: Any = StationSession if external else InternalSession
        session = kind(self, self.aspace, self.subscription_service, name, user=user or User(), external=external)
        if isinstance(session, StationSession):
            session.trust, session.watch = self._trust, self._watch
        return session

    def register_server(self, server: Any, conf: Any = None) -> None:
        """Refuse to tell clients of a server of somebody's."""
        del server, conf
        raise ServiceError(ua.StatusCodes.BadServiceUnsupported)

    def sessions(self) -> list[StationSession]:
        """Return the sessions of clients."""
        return [one for one in self._external_sessions.values() if isinstance(one, StationSession)]
