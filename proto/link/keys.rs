//! A node's keys: three files in a folder, and what TLS is set up from.
//!
//! The files are looked at before each handshake, and read again when one has changed, so keys are replaced without a
//! restart. They are written one after the other, so certificate and key may not match for a moment: keys that can't be used are
//! not taken, the ones before stay, and the next handshake looks again.

use crate::explain;
use crate::identity::{Identity, NodeRole};
use proto::limits;
use rustls::client::danger::ServerCertVerifier;
use rustls::client::{Resumption, WebPkiServerVerifier};
use rustls::crypto::{CryptoProvider, ring};
use rustls::pki_types::pem::PemObject;
use rustls::pki_types::{CertificateDer, PrivateKeyDer, ServerName, UnixTime};
use rustls::server::danger::{ClientCertVerified, ClientCertVerifier};
use rustls::server::{NoServerSessionStorage, WebPkiClientVerifier};
use rustls::{
    CertificateError, ClientConfig, DigitallySignedStruct, DistinguishedName, Error, InconsistentKeys, RootCertStore,
    ServerConfig, SignatureScheme, version,
};
use std::io::Read;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use thiserror::Error as ThisError;

/// The authority's certificate; of two authorities while a rig changes from one to the other.
pub const AUTHORITY_FILE: &str = "authority.pem";
/// The node's certificate.
pub const CERTIFICATE_FILE: &str = "certificate.pem";
/// The node's private key.
pub const KEY_FILE: &str = "key.pem";

/// Why keys can't be used.
#[derive(Debug, ThisError)]
#[non_exhaustive]
pub enum KeysError {
    /// A file isn't there, or isn't ours to read.
    #[error("{file}: {error}; `cyclorama keys issue` makes it", file = file.display())]
    Unreadable {
        /// The file.
        file: PathBuf,
        /// The reason.
        error: std::io::Error,
    },
    /// A file holds something else.
    #[error("{file}: {what}; `cyclorama keys issue` makes a good one", file = file.display())]
    Content {
        /// The file.
        file: PathBuf,
        /// What is wrong.
        what: String,
    },
    /// The private key is another certificate's.
    #[error("{file}: this key is not the one of {CERTIFICATE_FILE} beside it; copy both from where they were issued", file = file.display())]
    Mismatch {
        /// The key's file.
        file: PathBuf,
    },
    /// The certificate is fine, but for something else.
    #[error("{file}: this certificate is for the {found}, and a {needed} needs one of role {needed}", file = file.display())]
    Role {
        /// The certificate's file.
        file: PathBuf,
        /// Whom it is for.
        found: Identity,
        /// What the program is.
        needed: NodeRole,
    },
}

/// What handshakes are made with.
#[derive(Debug)]
pub(crate) struct Credentials {
    pub client: Arc<ClientConfig>,
    pub server: Arc<ServerConfig>,
    pub identity: Identity,
}

/// Tells whether a file is the one that was read: inode, length and time of change, in ns.
type Stamp = Option<(u64, u64, i64)>;
type Stamps = [Stamp; 3];

#[derive(Debug)]
struct State {
    current: Arc<Credentials>,
    /// Of what is current.
    stamps: Stamps,
    /// Of what was complained about last.
    bad: Option<Stamps>,
}

/// A folder of keys.
#[derive(Debug)]
pub(crate) struct Keys {
    folder: PathBuf,
    role: NodeRole,
    state: Mutex<State>,
}

impl Keys {
    /// Reads the keys of a node of this role.
    pub(crate) fn open(folder: &Path, role: NodeRole) -> Result<Self, KeysError> {
        let stamps = stamps(folder);
        let current = Arc::new(load(folder, role)?);
        let state = Mutex::new(State { current, stamps, bad: None });
        Ok(Self { folder: folder.to_owned(), role, state })
    }

    /// The newest keys that can be used. Reads files.
    pub(crate) fn current(&self) -> Arc<Credentials> {
        // Nothing here panics half-way through a change.
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        // Before reading: what changes meanwhile is read again next time.
        let stamps = stamps(&self.folder);
        if stamps != state.stamps {
            match load(&self.folder, self.role) {
                Ok(new) => {
                    tracing::info!(identity = %new.identity, fingerprint = %new.identity.fingerprint, "keys renewed");
                    (state.current, state.stamps, state.bad) = (Arc::new(new), stamps, None);
                }
                Err(error) if state.bad != Some(stamps) => {
                    tracing::warn!(%error, "new keys can't be used, so the old ones stay");
                    state.bad = Some(stamps);
                }
                Err(_) => {}
            }
        }
        state.current.clone()
    }
}

fn stamps(folder: &Path) -> Stamps {
    [AUTHORITY_FILE, CERTIFICATE_FILE, KEY_FILE].map(|name| {
        let data = std::fs::metadata(folder.join(name)).ok()?;
        Some((data.ino(), data.len(), data.mtime().wrapping_mul(1_000_000_000).wrapping_add(data.mtime_nsec())))
    })
}

fn read(file: &Path) -> Result<Vec<u8>, KeysError> {
    let mut bytes = Vec::new();
    std::fs::File::open(file)
        .and_then(|opened| opened.take(limits::KEY_FILE_MAX).read_to_end(&mut bytes))
        .map_err(|error| KeysError::Unreadable { file: file.to_owned(), error })?;
    Ok(bytes)
}

fn certificates(file: &Path) -> Result<Vec<CertificateDer<'static>>, KeysError> {
    let bad = |what: String| KeysError::Content { file: file.to_owned(), what };
    let found: Result<Vec<_>, _> = CertificateDer::pem_slice_iter(&read(file)?).collect();
    match found {
        Ok(found) if found.is_empty() => Err(bad("no certificate in it".into())),
        Ok(found) => Ok(found),
        Err(error) => Err(bad(error.to_string())),
    }
}

fn load(folder: &Path, role: NodeRole) -> Result<Credentials, KeysError> {
    let file = |name: &str| folder.join(name);
    let (authority_file, certificate_file, key_file) = (file(AUTHORITY_FILE), file(CERTIFICATE_FILE), file(KEY_FILE));
    let bad = |file: &Path, what: String| KeysError::Content { file: file.to_owned(), what };
    let mut roots = RootCertStore::empty();
    for certificate in certificates(&authority_file)? {
        roots.add(certificate).map_err(|error| bad(&authority_file, error.to_string()))?;
    }
    let (roots, chain) = (Arc::new(roots), certificates(&certificate_file)?);
    let key = PrivateKeyDer::from_pem_slice(&read(&key_file)?).map_err(|error| bad(&key_file, error.to_string()))?;
    warn_if_others_read(&key_file);

    let found = Identity::of(&chain[0]).ok_or_else(|| bad(&certificate_file, "it names no node of a rig".into()))?;
    if found.role != role {
        return Err(KeysError::Role { file: certificate_file, found, needed: role });
    }
    let provider = Arc::new(ring::default_provider());
    check_own(&roots, &provider, &chain, role).map_err(|what| bad(&certificate_file, what))?;
    let unusable = |error: Error| match error {
        Error::InconsistentKeys(InconsistentKeys::KeyMismatch) => KeysError::Mismatch { file: key_file.clone() },
        other => bad(&key_file, explain::reason(&other)),
    };
    Ok(Credentials {
        client: client(&roots, &provider, &chain, &key).map_err(unusable)?,
        server: server(&roots, &provider, chain, key, role).map_err(unusable)?,
        identity: found,
    })
}

/// A key that others can read is no secret. It may be meant so (a container's secrets often are), hence no error.
fn warn_if_others_read(file: &Path) {
    if std::fs::metadata(file).is_ok_and(|data| data.mode() & 0o077 != 0) {
        tracing::warn!(file = %file.display(), "others can read this private key; chmod 600 it");
    }
}

/// Looks at our own certificate as our peers will.
fn check_own(
    roots: &Arc<RootCertStore>,
    provider: &Arc<CryptoProvider>,
    chain: &[CertificateDer<'static>],
    role: NodeRole,
) -> Result<(), String> {
    let verifier = WebPkiServerVerifier::builder_with_provider(roots.clone(), provider.clone()).build();
    let verifier = verifier.map_err(|error| error.to_string())?;
    let name = ServerName::try_from(role.role_name()).map_err(|error| error.to_string())?;
    match verifier.verify_server_cert(&chain[0], &chain[1..], &name, &[], UnixTime::now()) {
        Ok(_) => Ok(()),
        Err(Error::InvalidCertificate(CertificateError::UnknownIssuer | CertificateError::BadSignature)) => {
            Err(format!("it is not of the authority in {AUTHORITY_FILE} beside it"))
        }
        Err(Error::InvalidCertificate(error)) => Err(format!("this certificate {}", explain::fault(&error))),
        Err(error) => Err(error.to_string()),
    }
}

fn client(
    roots: &Arc<RootCertStore>,
    provider: &Arc<CryptoProvider>,
    chain: &[CertificateDer<'static>],
    key: &PrivateKeyDer<'static>,
) -> Result<Arc<ClientConfig>, Error> {
    let mut config = ClientConfig::builder_with_provider(provider.clone())
        .with_protocol_versions(&[&version::TLS13])?
        .with_root_certificates(roots.clone())
        .with_client_auth_cert(chain.to_vec(), key.clone_key())?;
    // A resumed session is not asked for its certificate again.
    config.resumption = Resumption::disabled();
    Ok(Arc::new(config))
}

fn server(
    roots: &Arc<RootCertStore>,
    provider: &Arc<CryptoProvider>,
    chain: Vec<CertificateDer<'static>>,
    key: PrivateKeyDer<'static>,
    role: NodeRole,
) -> Result<Arc<ServerConfig>, Error> {
    let inner = WebPkiClientVerifier::builder_with_provider(roots.clone(), provider.clone()).build();
    let inner = inner.map_err(|error| Error::General(error.to_string()))?;
    let mut config = ServerConfig::builder_with_provider(provider.clone())
        .with_protocol_versions(&[&version::TLS13])?
        .with_client_cert_verifier(Arc::new(Roles { inner, accepts: role.accepts() }))
        .with_single_cert(chain, key)?;
    // As above.
    config.session_storage = Arc::new(NoServerSessionStorage {});
    config.send_tls13_tickets = 0;
    Ok(Arc::new(config))
}

/// Takes certificates of the authority, and of these roles only: inside the handshake, so that the peer is told.
#[derive(Debug)]
struct Roles {
    inner: Arc<dyn ClientCertVerifier>,
    accepts: &'static [NodeRole],
}

impl ClientCertVerifier for Roles {
    fn root_hint_subjects(&self) -> &[DistinguishedName] {
        self.inner.root_hint_subjects()
    }

    fn verify_client_cert(
        &self,
        certificate: &CertificateDer<'_>,
        intermediates: &[CertificateDer<'_>],
        now: UnixTime,
    ) -> Result<ClientCertVerified, Error> {
        let verified = self.inner.verify_client_cert(certificate, intermediates, now)?;
        match Identity::of(certificate) {
            Some(identity) if self.accepts.contains(&identity.role) => Ok(verified),
            _ => Err(CertificateError::ApplicationVerificationFailure.into()),
        }
    }

    fn verify_tls12_signature(
        &self,
        message: &[u8],
        certificate: &CertificateDer<'_>,
        signature: &DigitallySignedStruct,
    ) -> Result<rustls::client::danger::HandshakeSignatureValid, Error> {
        self.inner.verify_tls12_signature(message, certificate, signature)
    }

    fn verify_tls13_signature(
        &self,
        message: &[u8],
        certificate: &CertificateDer<'_>,
        signature: &DigitallySignedStruct,
    ) -> Result<rustls::client::danger::HandshakeSignatureValid, Error> {
        self.inner.verify_tls13_signature(message, certificate, signature)
    }

    fn supported_verify_schemes(&self) -> Vec<SignatureScheme> {
        self.inner.supported_verify_schemes()
    }
}
