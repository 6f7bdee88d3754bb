//! Who may look, and who may change something.
//!
//! Anybody who reaches the console may look. Changing something takes the token, if there is one; without one it can be done on this machine only. And a browser
//! is everybody's: a page from elsewhere may open sockets to this machine and send what it likes, and by a name that it makes point here it is even
//! of the same origin. So whatever a browser says must come from a page of this console, and a console that listens on this machine only must be
//! called by one of this machine's names.

use crate::backplane::Token;
use axum::http::header::{AUTHORIZATION, HOST, ORIGIN, WWW_AUTHENTICATE};
use axum::http::{HeaderMap, StatusCode};
use axum::response::{IntoResponse, Response};
use serde::Serialize;
use std::net::{IpAddr, SocketAddr};

/// What it takes to change something.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum Controls {
    /// Nothing.
    Open,
    /// The token.
    Token,
    /// It can't be done.
    None,
}

/// Why somebody isn't let.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub(super) enum Denied {
    #[error("this comes from a page at {0}, which is not this console's")]
    Site(String),
    #[error(
        "this console listens on its own machine only and isn't called {0:?}; use localhost or the address it was started with"
    )]
    Host(String),
    #[error("give the console's token: it is missing, or it is another")]
    Token,
    #[error(
        "this console is read-only: it can be reached from other machines, and no token was given with --console-token"
    )]
    ReadOnly,
}

impl IntoResponse for Denied {
    fn into_response(self) -> Response {
        let body = super::problem(&self.to_string());
        match self {
            Self::Token => (StatusCode::UNAUTHORIZED, [(WWW_AUTHENTICATE, "Bearer")], body).into_response(),
            _ => (StatusCode::FORBIDDEN, body).into_response(),
        }
    }
}

/// See the module's head.
#[derive(Clone, Copy, Debug)]
pub(super) struct Access {
    token: Option<Token>,
    is_loopback: bool,
}

impl Access {
    pub(super) fn new(listen: SocketAddr, token: Option<Token>) -> Self {
        Self { token, is_loopback: listen.ip().is_loopback() }
    }

    pub(super) fn controls(&self) -> Controls {
        match (self.token, self.is_loopback) {
            (Some(_), _) => Controls::Token,
            (None, true) => Controls::Open,
            (None, false) => Controls::None,
        }
    }

    /// Whether whoever asks is no foreign page.
    pub(super) fn check_site(&self, headers: &HeaderMap) -> Result<(), Denied> {
        let text = |name| headers.get(name).map(|value| String::from_utf8_lossy(value.as_bytes()).into_owned());
        let host = text(HOST).unwrap_or_default();
        if self.is_loopback && !is_of_this_machine(&host) {
            return Err(Denied::Host(host));
        }
        match text(ORIGIN) {
            // No browser.
            None => Ok(()),
            Some(origin) => {
                let authority = origin.strip_prefix("http://").or(origin.strip_prefix("https://"));
                let is_own = authority.is_some_and(|authority| authority.eq_ignore_ascii_case(&host));
                if is_own { Ok(()) } else { Err(Denied::Site(origin)) }
            }
        }
    }

    /// Whether whoever asks may change something.
    pub(super) fn check_control(&self, headers: &HeaderMap) -> Result<(), Denied> {
        self.check_site(headers)?;
        let said = headers.get(AUTHORIZATION).and_then(|value| value.to_str().ok()?.strip_prefix("Bearer "));
        match (self.controls(), &self.token) {
            (Controls::Open, _) => Ok(()),
            (_, Some(token)) if said.is_some_and(|said| token.is(said)) => Ok(()),
            (_, Some(_)) => Err(Denied::Token),
            (_, None) => Err(Denied::ReadOnly),
        }
    }
}

/// Whether `host`, maybe with a port, is a name or address that is always this machine's.
fn is_of_this_machine(host: &str) -> bool {
    let name = match host.strip_prefix('[') {
        Some(rest) => rest.split(']').next().unwrap_or_default(),
        None => host.split(':').next().unwrap_or_default(),
    };
    name.eq_ignore_ascii_case("localhost") || name.parse().is_ok_and(|address: IpAddr| address.is_loopback())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn access(listen: &str, token: Option<&str>) -> Access {
        Access::new(listen.parse().unwrap(), token.map(|token| Token::new(token).unwrap()))
    }

    fn headers(pairs: &[(axum::http::HeaderName, &str)]) -> HeaderMap {
        pairs.iter().map(|(name, value)| (name.clone(), value.parse().unwrap())).collect()
    }

    #[test]
    fn a_console_on_this_machine_is_called_by_its_names_only() {
        let access = access("127.0.0.1:7480", None);
        for host in ["127.0.0.1:7480", "localhost:9", "LOCALHOST", "[::1]:7480", "127.8.8.8"] {
            assert_eq!(access.check_control(&headers(&[(HOST, host)])), Ok(()), "{host}");
        }
        for host in ["rig.example:7480", "127.0.0.1.example", "10.0.0.1", "", "localhost.example", "[fe80::1]:7480"] {
            let denied = access.check_site(&headers(&[(HOST, host)]));
            assert_eq!(denied, Err(Denied::Host(host.into())), "{host}: a page could make that name point here");
        }
    }

    #[test]
    fn a_page_from_elsewhere_is_refused_whatever_the_address() {
        let own = [(HOST, "127.0.0.1:7480"), (ORIGIN, "http://127.0.0.1:7480")];
        assert_eq!(access("127.0.0.1:7480", None).check_control(&headers(&own)), Ok(()));
        for origin in ["http://evil.example", "http://127.0.0.1:8000", "null", "file://", "https://localhost:7480"] {
            for listen in ["127.0.0.1:7480", "0.0.0.0:7480"] {
                let asked = headers(&[(HOST, "127.0.0.1:7480"), (ORIGIN, origin)]);
                assert_eq!(access(listen, None).check_site(&asked), Err(Denied::Site(origin.into())), "{listen}");
            }
        }
    }

    #[test]
    fn beyond_this_machine_nothing_changes_without_a_token() {
        let host = [(HOST, "rig:7480")];
        let open = access("0.0.0.0:7480", None);
        assert_eq!((open.controls(), open.check_site(&headers(&host))), (Controls::None, Ok(())));
        assert_eq!(open.check_control(&headers(&host)), Err(Denied::ReadOnly));
        for listen in ["0.0.0.0:7480", "127.0.0.1:7480"] {
            let kept = access(listen, Some("a long secret"));
            let with = |said| headers(&[(HOST, "localhost"), (AUTHORIZATION, said)]);
            assert_eq!(kept.controls(), Controls::Token);
            assert_eq!(kept.check_control(&with("Bearer a long secret")), Ok(()));
            for wrong in ["Bearer a long secre", "a long secret", "Bearer "] {
                assert_eq!(kept.check_control(&with(wrong)), Err(Denied::Token), "{wrong}");
            }
            assert_eq!(kept.check_control(&headers(&[(HOST, "localhost")])), Err(Denied::Token));
        }
    }
}
