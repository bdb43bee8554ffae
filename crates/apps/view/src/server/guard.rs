//! Who may ask: pages of this server only.

use super::ARRIVES_WITHIN;
use axum::body::{Body, to_bytes};
use axum::extract::{Request, State};
use axum::http::header::{CACHE_CONTROL, CONTENT_SECURITY_POLICY, CONTENT_TYPE, COOKIE, HOST, ORIGIN, SET_COOKIE};
use axum::http::header::{REFERRER_POLICY, X_CONTENT_TYPE_OPTIONS, X_FRAME_OPTIONS};
use axum::http::uri::Authority;
use axum::http::{HeaderMap, HeaderName, HeaderValue, Method, StatusCode, Uri};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use std::net::SocketAddr;
use std::sync::Arc;

/// The longest body of a request \[bytes\].
const MAX_BODY: usize = 64 * 1024;

/// The cookie of the token of the server of a port. A browser sends the cookies of a host to all of its ports.
fn cookie_name(port: u16) -> String {
    format!("dunkelfeld-view-{port}")
}

/// Decides about requests. A page of another site could send requests to the loopback interface, and a name of another site
/// could lead to it (DNS rebinding). So the name of the host and the origin must be those of this server.
#[derive(Clone, Debug)]
pub(crate) struct Guard {
    /// Names of this server with its port.
    hosts: Arc<Vec<String>>,
    cookie: Arc<str>,
    /// A server on other interfaces also needs a token.
    token: Option<Arc<str>>,
}

impl Guard {
    /// For a server that listens on this address. `token` is required if it is not on the loopback interface.
    pub(crate) fn new(address: SocketAddr, token: Option<String>) -> Self {
        let port = address.port();
        let mut hosts = vec![format!("127.0.0.1:{port}"), format!("localhost:{port}"), format!("[::1]:{port}")];
        hosts.push(address.to_string());
        // Clients leave out the standard port.
        if port == 80 {
            let without_port: Vec<String> =
                hosts.iter().filter_map(|host| host.strip_suffix(":80")).map(str::to_owned).collect();
            hosts.extend(without_port);
        }
        Self { hosts: Arc::new(hosts), cookie: cookie_name(port).into(), token: token.map(Into::into) }
    }

    /// The reason why a request is refused.
    fn refusal(&self, (method, uri): (&Method, &Uri), headers: &HeaderMap, is_first: bool) -> Option<&'static str> {
        // A value that is no text is that of no page of this server.
        let text = |name: &HeaderName| headers.get(name).map(|value: &HeaderValue| value.to_str().unwrap_or("?"));
        let is_twice = |name: &HeaderName| headers.get_all(name).iter().nth(1).is_some();
        let site = HeaderName::from_static("sec-fetch-site");
        let is_own = |host: &str| self.hosts.iter().any(|own| own.eq_ignore_ascii_case(host));
        // Of two values, another program may read the other one.
        if is_twice(&HOST) {
            return Some("the request names two hosts");
        }
        if [&ORIGIN, &CONTENT_TYPE, &site].into_iter().any(is_twice) {
            return Some("the request has two values of a header that is checked");
        }
        // A target in the form for proxies has a name too.
        if let Some(name) = uri.authority().map(Authority::as_str) {
            let is_same = if self.token.is_none() { is_own(name) } else { text(&HOST) == Some(name) };
            if !is_same {
                return Some("the request names another host");
            }
        }
        // With a token, the server may have any name.
        if self.token.is_none() && !text(&HOST).is_some_and(is_own) {
            return Some("the request names another host");
        }
        if let Some(origin) = text(&ORIGIN) {
            let host = origin.strip_prefix("http://").unwrap_or_default();
            let is_same = if self.token.is_none() { is_own(host) } else { text(&HOST) == Some(host) };
            if !is_same {
                return Some("the request comes from another page");
            }
        }
        if text(&site).is_some_and(|site| site == "cross-site") && !is_first {
            return Some("the request comes from another site");
        }
        let is_json = text(&CONTENT_TYPE).is_some_and(|kind| kind.split(';').next() == Some("application/json"));
        if *method == Method::POST && !is_json {
            return Some("the body is not JSON");
        }
        if !is_first && !self.has_token(headers) {
            return Some("the token is missing: open the address that the program has printed");
        }
        None
    }

    fn has_token(&self, headers: &HeaderMap) -> bool {
        let Some(token) = &self.token else { return true };
        let cookies = headers.get_all(COOKIE).iter().filter_map(|value| value.to_str().ok());
        let mut pairs = cookies.flat_map(|cookies| cookies.split(';')).filter_map(|pair| pair.trim().split_once('='));
        pairs.any(|(name, value)| name == &*self.cookie && is_equal(value, token))
    }

    /// Does the query contain the token?
    fn is_invited(&self, query: Option<&str>) -> bool {
        let Some(token) = &self.token else { return true };
        let mut pairs = query.unwrap_or_default().split('&').filter_map(|pair| pair.split_once('='));
        pairs.any(|(name, value)| name == "token" && is_equal(value, token))
    }
}

/// Compares in a time that does not depend on the place of a difference.
fn is_equal(a: &str, b: &str) -> bool {
    a.len() == b.len() && a.bytes().zip(b.bytes()).fold(0, |all, (a, b)| all | (a ^ b)) == 0
}

/// Refuses foreign requests, and adds the headers of security to all answers.
pub(super) async fn check(State(guard): State<Guard>, request: Request, next: Next) -> Response {
    let is_page = request.uri().path() == "/";
    let is_invited = is_page && guard.is_invited(request.uri().query());
    let refusal = guard.refusal((request.method(), request.uri()), request.headers(), is_invited);
    let mut response = match refusal {
        Some(reason) => (StatusCode::FORBIDDEN, format!("{reason}\n")).into_response(),
        None => {
            let (head, body) = request.into_parts();
            match tokio::time::timeout(ARRIVES_WITHIN, to_bytes(body, MAX_BODY)).await {
                Ok(Ok(body)) => next.run(Request::from_parts(head, Body::from(body))).await,
                Ok(Err(_)) => (StatusCode::PAYLOAD_TOO_LARGE, "the body is too long, or broken\n").into_response(),
                Err(_) => (StatusCode::REQUEST_TIMEOUT, "the body does not arrive\n").into_response(),
            }
        }
    };
    let headers = response.headers_mut();
    let policy = "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data: blob:; \
                  connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'";
    for (name, value) in [
        (CACHE_CONTROL, "no-store"),
        (CONTENT_SECURITY_POLICY, policy),
        (REFERRER_POLICY, "no-referrer"),
        (X_CONTENT_TYPE_OPTIONS, "nosniff"),
        (X_FRAME_OPTIONS, "DENY"),
    ] {
        headers.insert(name, HeaderValue::from_static(value));
    }
    if let (None, true, Some(token)) = (refusal, is_invited, &guard.token)
        && let Ok(cookie) = format!("{}={token}; Path=/; HttpOnly; SameSite=Strict", guard.cookie).parse()
    {
        headers.insert(SET_COOKIE, cookie);
    }
    response.map(Body::new)
}

#[cfg(test)]
mod tests {
    use super::*;
    use axum::http::HeaderName;

    fn headers(entries: &[(&'static str, &str)]) -> HeaderMap {
        let pair = |&(name, value): &(&str, &str)| {
            (name.parse::<HeaderName>().expect("name"), value.parse::<HeaderValue>().expect("value"))
        };
        let mut headers = HeaderMap::new();
        for (name, value) in entries.iter().map(pair) {
            headers.append(name, value);
        }
        headers
    }

    fn refuses(guard: &Guard, method: Method, entries: &[(&'static str, &str)]) -> bool {
        guard.refusal((&method, &Uri::from_static("/api/state")), &headers(entries), false).is_some()
    }

    /// A target in the form for proxies, and a second name.
    #[test]
    fn other_names_of_the_host_are_refused() {
        let own = headers(&[("host", "127.0.0.1:7000"), ("cookie", "dunkelfeld-view-7000=0123abcd")]);
        let both = headers(&[("host", "127.0.0.1:7000"), ("host", "evil.example")]);
        for token in [None, Some("0123abcd".to_owned())] {
            let guard = Guard::new(([127, 0, 0, 1], 7000).into(), token);
            let refusal = |target: &'static str, headers: &HeaderMap| {
                guard.refusal((&Method::GET, &Uri::from_static(target)), headers, false)
            };
            assert_eq!(refusal("/api/state", &own), None);
            assert_eq!(refusal("http://127.0.0.1:7000/api/state", &own), None);
            assert_eq!(refusal("http://evil.example/api/state", &own), Some("the request names another host"));
            assert_eq!(refusal("http://evil.example@127.0.0.1:7000/", &own), Some("the request names another host"));
            assert_eq!(refusal("/api/state", &both), Some("the request names two hosts"));
        }
    }

    /// Clients leave out the standard port of `http` in host and origin.
    #[test]
    fn the_standard_port_needs_no_number() {
        let names = ["127.0.0.1", "localhost", "[::1]", "127.0.0.1:80", "localhost:80"];
        let is_own = |port: u16, host: &str| {
            let origin = format!("http://{host}");
            let guard = Guard::new(([127, 0, 0, 1], port).into(), None);
            !refuses(&guard, Method::GET, &[("host", host), ("origin", &origin)])
        };
        assert!(names.iter().all(|host| is_own(80, host)));
        assert!(names.iter().all(|host| !is_own(8080, host)));
    }

    #[test]
    fn foreign_hosts_origins_and_forms_are_refused() {
        let guard = Guard::new(([127, 0, 0, 1], 7000).into(), None);
        let own = ("host", "127.0.0.1:7000");
        assert!(!refuses(&guard, Method::GET, &[own]));
        assert!(!refuses(&guard, Method::GET, &[("host", "LocalHost:7000")]));
        assert!(!refuses(&guard, Method::GET, &[("host", "[::1]:7000")]));
        let json = ("content-type", "application/json; charset=utf-8");
        assert!(!refuses(&guard, Method::POST, &[own, json, ("origin", "http://127.0.0.1:7000")]));
        for entries in [
            &[][..],
            &[("host", "evil.example:7000")],
            &[("host", "127.0.0.1:7001")],
            &[("host", "127.0.0.1")],
            &[own, ("origin", "http://evil.example")],
            &[own, ("origin", "https://127.0.0.1:7000")],
            &[own, ("origin", "null")],
            &[own, ("origin", "http://127.0.0.1:7000"), ("origin", "http://evil.example")],
            &[own, ("sec-fetch-site", "same-origin"), ("sec-fetch-site", "cross-site")],
            &[own, ("sec-fetch-site", "cross-site")],
        ] {
            assert!(refuses(&guard, Method::GET, entries), "{entries:?}");
        }
        assert!(refuses(&guard, Method::POST, &[own]), "a form of another page");
        assert!(refuses(&guard, Method::POST, &[own, ("content-type", "text/plain")]));
        assert!(refuses(&guard, Method::POST, &[own, json, ("content-type", "text/plain")]));
        // An origin that is no text.
        let mut unreadable = headers(&[own]);
        unreadable.insert(ORIGIN, HeaderValue::from_bytes(b"http://\xe9vil.example").expect("a value"));
        let uri = Uri::from_static("/api/state");
        assert!(guard.refusal((&Method::GET, &uri), &unreadable, false).is_some());
    }

    #[test]
    fn a_token_is_required_where_one_is_set() {
        let guard = Guard::new(([0, 0, 0, 0], 7000).into(), Some("0123abcd".into()));
        let host = ("host", "station:7000");
        assert!(refuses(&guard, Method::GET, &[host]));
        assert!(refuses(&guard, Method::GET, &[host, ("cookie", "dunkelfeld-view-7000=0123abce")]));
        assert!(refuses(&guard, Method::GET, &[host, ("cookie", "dunkelfeld-view-7000=")]));
        assert!(!refuses(&guard, Method::GET, &[host, ("cookie", "a=b; dunkelfeld-view-7000=0123abcd")]));
        // The cookie of a view on another port of the same host comes too, and does not disturb.
        assert!(!refuses(
            &guard,
            Method::GET,
            &[host, ("cookie", "dunkelfeld-view-7001=f00d; dunkelfeld-view-7000=0123abcd")]
        ));
        assert!(refuses(&guard, Method::GET, &[host, ("cookie", "dunkelfeld-view-7001=0123abcd")]));
        assert!(guard.is_invited(Some("a=b&token=0123abcd")) && !guard.is_invited(Some("token=0123abc")));
        assert!(!guard.is_invited(None));
        let other = ("origin", "http://evil.example");
        assert!(refuses(&guard, Method::GET, &[host, other, ("cookie", "dunkelfeld-view-7000=0123abcd")]));
    }
}
