//! Who may ask: one who knows the token, by a name of this machine, from the page itself.

use axum::body::Body;
use axum::extract::{Request, State};
use axum::http::header::{AUTHORIZATION, COOKIE, HOST, LOCATION, ORIGIN, SET_COOKIE};
use axum::http::{HeaderMap, HeaderName, HeaderValue, Method, StatusCode, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};

use crate::failure::ViewError;

/// The token, and the name of the cookie that carries it. Browsers do not tell ports apart in cookies: each server has a
/// cookie of its own.
#[derive(Debug, Clone)]
pub(crate) struct Guard {
    token: String,
    cookie: String,
}

/// 192 random bits.
const TOKEN_BYTES: usize = 24;

impl Guard {
    pub(crate) fn new(port: u16) -> Result<Self, ViewError> {
        let mut bytes = [0u8; TOKEN_BYTES];
        getrandom::fill(&mut bytes).map_err(|error| ViewError::Random(error.to_string()))?;
        let token = bytes.iter().map(|byte| format!("{byte:02x}")).collect();
        Ok(Self { token, cookie: format!("retina-view-{port}") })
    }

    pub(crate) fn token(&self) -> &str {
        &self.token
    }

    /// Compared in full, so that the time tells nothing.
    fn is_token(&self, given: &str) -> bool {
        let (own, given) = (self.token.as_bytes(), given.as_bytes());
        own.len() == given.len() && own.iter().zip(given).fold(0, |sum, (a, b)| sum | (a ^ b)) == 0
    }

    fn knows(&self, headers: &HeaderMap) -> bool {
        let bearer =
            headers.get(AUTHORIZATION).and_then(|value| value.to_str().ok()?.strip_prefix("Bearer "));
        let mut cookies = headers
            .get_all(COOKIE)
            .iter()
            .filter_map(|value| value.to_str().ok())
            .flat_map(|value| value.split(';'))
            .filter_map(|pair| pair.trim().split_once('='));
        bearer.is_some_and(|token| self.is_token(token))
            || cookies.any(|(name, value)| name == self.cookie && self.is_token(value))
    }

    /// The token of the address, where it has one.
    fn of_query<'a>(&self, query: Option<&'a str>) -> Option<&'a str> {
        query?.split('&').find_map(|pair| pair.strip_prefix("token="))
    }
}

/// Whether a host, with or without a port, is this machine's loopback. Other names may be made to point here by whoever
/// owns them (DNS rebinding). The port may be another one: an ssh tunnel has its own.
fn is_loopback(host: &str) -> bool {
    let name = if host.starts_with('[') {
        host.find(']').map_or(host, |end| &host[..=end])
    } else {
        host.rsplit_once(':').map_or(host, |(name, _)| name)
    };
    ["127.0.0.1", "localhost", "[::1]"].contains(&name)
}

/// Headers of every answer. The page fetches nothing from elsewhere, and runs no text as a program.
const HEADERS: [(HeaderName, &str); 6] = [
    (
        header::CONTENT_SECURITY_POLICY,
        "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; connect-src 'self'; \
         base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    ),
    (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
    (header::X_FRAME_OPTIONS, "DENY"),
    (header::REFERRER_POLICY, "no-referrer"),
    (header::CACHE_CONTROL, "no-store"),
    (HeaderName::from_static("cross-origin-resource-policy"), "same-origin"),
];

/// Refuses, or answers with the headers above. The address with the token is exchanged for a cookie, so that the token
/// does not stay in the browser's history.
pub(crate) async fn guarded(State(guard): State<Guard>, request: Request, next: Next) -> Response {
    let mut response = match admitted(&guard, &request) {
        Ok(None) => next.run(request).await,
        Ok(Some(response)) => response,
        Err(text) => (StatusCode::FORBIDDEN, text).into_response(),
    };
    for (name, value) in HEADERS {
        response.headers_mut().insert(name, HeaderValue::from_static(value));
    }
    response
}

fn admitted(guard: &Guard, request: &Request<Body>) -> Result<Option<Response>, &'static str> {
    let headers = request.headers();
    let host = headers.get(HOST).and_then(|host| host.to_str().ok()).unwrap_or_default();
    if !is_loopback(host) {
        return Err("refused: this server answers only to 127.0.0.1 and localhost\n");
    }
    // Another page of this browser may send forms here, and its cookies go with them unless they are strict.
    if let Some(origin) = headers.get(ORIGIN) {
        let same = origin.to_str().ok().and_then(|text| text.strip_prefix("http://")) == Some(host);
        if !same {
            return Err("refused: the request comes from another page\n");
        }
    }
    if let Some(token) = guard.of_query(request.uri().query())
        && request.uri().path() == "/"
        && request.method() == Method::GET
    {
        if !guard.is_token(token) {
            return Err(WRONG_TOKEN);
        }
        let cookie = format!("{}={token}; Path=/; HttpOnly; SameSite=Strict", guard.cookie);
        return Ok(Some(
            (StatusCode::SEE_OTHER, [(LOCATION, "/".to_owned()), (SET_COOKIE, cookie)]).into_response(),
        ));
    }
    if guard.knows(headers) { Ok(None) } else { Err(WRONG_TOKEN) }
}

const WRONG_TOKEN: &str =
    "refused: the token is missing or wrong\nOpen the whole address that `retina view` printed.\n";

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_other_machines_are_refused() {
        for host in ["127.0.0.1", "127.0.0.1:80", "localhost:9000", "[::1]", "[::1]:8000"] {
            assert!(is_loopback(host), "{host}");
        }
        for host in
            ["", "example.org", "127.0.0.1.example.org", "localhost.example.org:80", "10.0.0.1", "[::2]:80"]
        {
            assert!(!is_loopback(host), "{host}");
        }
    }

    #[test]
    fn tokens_are_long_and_different() {
        let (a, b) = (Guard::new(1).unwrap(), Guard::new(1).unwrap());
        assert_eq!(a.token().len(), 2 * TOKEN_BYTES);
        assert_ne!(a.token(), b.token());
        assert!(a.is_token(a.token()) && !a.is_token(b.token()) && !a.is_token(""));
    }
}
