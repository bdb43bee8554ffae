//! The addresses of the page.

use dunkelfeld::io::PrivateFile;
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr, UdpSocket};

/// The addresses of the page, with the token if the view has one.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct PageAddress {
    /// The address for a browser of this computer.
    pub local: String,
    /// The address for browsers of other computers, if the view listens on all interfaces and there is a network.
    pub network: Option<String>,
    /// Do the addresses contain a token? Then they are secret.
    pub has_token: bool,
}

impl PageAddress {
    /// The addresses of a server that listens on `listen`.
    pub(crate) fn new(listen: SocketAddr, token: Option<&str>) -> Self {
        Self::with_network(listen, token, outward)
    }

    fn with_network(listen: SocketAddr, token: Option<&str>, network: impl FnOnce(IpAddr) -> Option<IpAddr>) -> Self {
        let query = token.map_or(String::new(), |token| format!("?token={token}"));
        let page = |ip: IpAddr| format!("http://{}/{query}", SocketAddr::new(ip, listen.port()));
        let has_token = token.is_some();
        if !listen.ip().is_unspecified() {
            return Self { local: format!("http://{listen}/{query}"), network: None, has_token };
        }
        // No browser connects to 0.0.0.0.
        let local = match listen.ip() {
            IpAddr::V4(_) => IpAddr::V4(Ipv4Addr::LOCALHOST),
            IpAddr::V6(_) => IpAddr::V6(Ipv6Addr::LOCALHOST),
        };
        Self { local: page(local), network: network(listen.ip()).map(page), has_token }
    }

    /// A page that only its owner can read, and that leads to the address of this computer. The name of a file may stand in
    /// the list of processes, a token may not.
    ///
    /// # Errors
    /// The folder of temporary files cannot be written to.
    pub fn redirect(&self) -> std::io::Result<PrivateFile> {
        let address = &self.local;
        let text = format!(
            "<!doctype html>\n<meta charset=\"utf-8\">\n<meta name=\"referrer\" content=\"no-referrer\">\n\
             <meta http-equiv=\"refresh\" content=\"0; url={address}\">\n<title>dunkelfeld view</title>\n\
             <p><a href=\"{address}\">The page of the view</a></p>\n"
        );
        PrivateFile::new(".html", &text)
    }
}

/// The address of this computer in the network that leads outward. `None` without one.
fn outward(any: IpAddr) -> Option<IpAddr> {
    let socket = UdpSocket::bind(SocketAddr::new(any, 0)).ok()?;
    // An address that exists nowhere (RFC 5737, RFC 3849). A datagram socket that is connected sends nothing.
    let elsewhere = match any {
        IpAddr::V4(_) => IpAddr::V4(Ipv4Addr::new(192, 0, 2, 1)),
        IpAddr::V6(_) => IpAddr::V6(Ipv6Addr::new(0x2001, 0xdb8, 0, 0, 0, 0, 0, 1)),
    };
    socket.connect(SocketAddr::new(elsewhere, 9)).ok()?;
    let ip = socket.local_addr().ok()?.ip();
    (!ip.is_unspecified() && !ip.is_loopback()).then_some(ip)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_can_be_used() {
        let of = |listen: &str, token| {
            let network = |any: IpAddr| (any.is_ipv4()).then_some(IpAddr::V4(Ipv4Addr::new(10, 0, 0, 7)));
            let address = PageAddress::with_network(listen.parse().expect("an address"), token, network);
            (address.local, address.network)
        };
        assert_eq!(of("127.0.0.1:80", None), ("http://127.0.0.1:80/".into(), None));
        assert_eq!(of("10.0.0.7:80", Some("0f")), ("http://10.0.0.7:80/?token=0f".into(), None));
        assert_eq!(of("[fe80::1]:80", Some("0f")), ("http://[fe80::1]:80/?token=0f".into(), None));
        let network = Some("http://10.0.0.7:8080/?token=0f".to_owned());
        assert_eq!(of("0.0.0.0:8080", Some("0f")), ("http://127.0.0.1:8080/?token=0f".into(), network));
        assert_eq!(of("[::]:8080", Some("0f")), ("http://[::1]:8080/?token=0f".into(), None));
    }

    #[test]
    fn the_redirect_leads_to_the_address() {
        let listen = ([0, 0, 0, 0], 7000).into();
        let address = PageAddress::with_network(listen, Some("0123abcd"), |_| None);
        let file = address.redirect().expect("temporary files work");
        let text = std::fs::read_to_string(file.path()).expect("readable");
        assert!(text.contains("url=http://127.0.0.1:7000/?token=0123abcd\""), "{text}");
        assert!(!file.path().to_string_lossy().contains("0123abcd"));
    }
}
