//! Who a peer is, by its certificate.

use proto::limits;
use rustls::pki_types::CertificateDer;
use std::fmt;

/// The domain of all names of nodes. It is not one of the Internet's, so no public authority can issue a name in it.
const DOMAIN: &str = "rig";

/// What a node is in the rig.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum NodeRole {
    /// The scene manager.
    Manager,
    /// A channel worker.
    Board,
    /// The compositor.
    Compositor,
}

impl NodeRole {
    /// All roles.
    pub const ALL: [Self; 3] = [Self::Manager, Self::Board, Self::Compositor];

    /// As it stands in certificates and on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Manager => "manager",
            Self::Board => "board",
            Self::Compositor => "compositor",
        }
    }

    /// Who may open a link to a node of this role.
    pub(crate) fn accepts(self) -> &'static [Self] {
        match self {
            // The other one stands by.
            Self::Manager => &[Self::Board, Self::Compositor, Self::Manager],
            // Its right neighbour.
            Self::Board => &[Self::Board],
            Self::Compositor => &[Self::Board],
        }
    }

    /// The name that every node of this role has: `board.rig`.
    pub fn role_name(self) -> String {
        format!("{}.{DOMAIN}", self.name())
    }

    /// The name of one node: `pc1.board.rig`.
    pub fn node_name(self, name: &str) -> String {
        format!("{name}.{}.{DOMAIN}", self.name())
    }
}

impl fmt::Display for NodeRole {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// The SHA-256 of a certificate.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Fingerprint(pub [u8; 32]);

impl Fingerprint {
    /// Of a certificate's DER.
    pub fn of(certificate: &[u8]) -> Self {
        let mut bytes = [0; 32];
        bytes.copy_from_slice(ring::digest::digest(&ring::digest::SHA256, certificate).as_ref());
        Self(bytes)
    }
}

impl fmt::Display for Fingerprint {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.iter().try_for_each(|byte| write!(f, "{byte:02x}"))
    }
}

impl fmt::Debug for Fingerprint {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(self, f)
    }
}

/// What a certificate says of its owner.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Identity {
    /// What it is.
    pub role: NodeRole,
    /// What the authority calls it. It stays when the certificate is renewed.
    pub name: String,
    /// Of the certificate.
    pub fingerprint: Fingerprint,
}

impl Identity {
    /// Reads the names of a certificate; `None` if it isn't a node's of a rig: exactly a role's name and a node's name of that role.
    /// Whether the rig's authority has issued it is another question.
    pub fn of(certificate: &CertificateDer<'_>) -> Option<Self> {
        let parsed = webpki::EndEntityCert::try_from(certificate).ok()?;
        let mut names: Vec<&str> = parsed.valid_dns_names().collect();
        names.sort_by_key(|name| name.len());
        let [short, long] = names[..] else { return None };
        let role = NodeRole::ALL.into_iter().find(|role| role.role_name() == short)?;
        let name = long.strip_suffix(short)?.strip_suffix('.').filter(|name| is_node_name(name))?.to_owned();
        Some(Self { role, name, fingerprint: Fingerprint::of(certificate) })
    }
}

impl fmt::Display for Identity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} {}", self.role, self.name)
    }
}

/// Whether this can be a node's name: a label of the domain name system in small letters.
pub fn is_node_name(name: &str) -> bool {
    let is_letter = |c: u8| c.is_ascii_lowercase() || c.is_ascii_digit() || c == b'-';
    !name.is_empty()
        && name.len() <= limits::NODE_NAME_MAX
        && name.bytes().all(is_letter)
        && !name.starts_with('-')
        && !name.ends_with('-')
}
