//! What went wrong with TLS, in words that tell what to do.

use crate::date::utc;
use rustls::pki_types::UnixTime;
use rustls::{AlertDescription, CertificateError, Error, PeerIncompatible};
use std::io;

/// The same error in plain words, if it is one of TLS.
pub(crate) fn plainly(error: io::Error) -> io::Error {
    match error.get_ref().and_then(|inner| inner.downcast_ref::<Error>()) {
        Some(tls) => io::Error::new(error.kind(), reason(tls)),
        None => error,
    }
}

/// Why TLS failed; of the other side, unless it says otherwise.
pub(crate) fn reason(error: &Error) -> String {
    match error {
        Error::InvalidCertificate(error) => format!("its certificate {}", fault(error)),
        Error::AlertReceived(alert) => complaint(*alert),
        Error::NoCertificatesPresented => "it shows no certificate; give it keys of this rig (--keys)".into(),
        Error::InvalidMessage(_) => "it doesn't speak TLS; start it with keys of this rig (--keys)".into(),
        Error::PeerIncompatible(PeerIncompatible::SupportedVersionsExtensionRequired) => {
            "it doesn't speak TLS 1.3".into()
        }
        other => other.to_string(),
    }
}

/// What is wrong with a certificate: the end of a sentence that begins with it.
pub(crate) fn fault(error: &CertificateError) -> String {
    match error {
        CertificateError::Expired => "has expired".into(),
        CertificateError::ExpiredContext { not_after, .. } => format!("has expired on {}", date(*not_after)),
        CertificateError::NotValidYet => "is not valid yet; compare the machines' clocks".into(),
        CertificateError::NotValidYetContext { not_before, .. } => {
            format!("is not valid before {}; compare the machines' clocks", date(*not_before))
        }
        CertificateError::UnknownIssuer | CertificateError::BadSignature => "is of another rig's authority".into(),
        CertificateError::NotValidForName => "is another node's".into(),
        CertificateError::NotValidForNameContext { expected, presented } => {
            let names: Vec<&str> = presented.iter().map(|name| bare(name)).collect();
            format!("is for {}, not for {}", names.join(" and "), expected.to_str())
        }
        CertificateError::ApplicationVerificationFailure => "is of a role that has no business here".into(),
        other => format!("is not usable: {other}"),
    }
}

/// rustls presents names as `DnsName("board.rig")`.
fn bare(name: &str) -> &str {
    name.split('"').nth(1).unwrap_or(name)
}

/// What the other side says of us.
fn complaint(alert: AlertDescription) -> String {
    let what = match alert {
        AlertDescription::CertificateExpired => "our certificate has expired, or our clock and its clock differ",
        AlertDescription::UnknownCA | AlertDescription::DecryptError => {
            "our certificate is of another rig's authority than its own"
        }
        AlertDescription::AccessDenied => "our certificate is of a role that has no business there",
        AlertDescription::CertificateRequired => "it wants a certificate; start this program with --keys",
        AlertDescription::BadCertificate | AlertDescription::CertificateUnknown => {
            "our certificate is not the one that it expects"
        }
        other => return format!("the other side refuses us: {other:?}"),
    };
    format!("the other side refuses us: {what}")
}

fn date(time: UnixTime) -> String {
    utc(i64::try_from(time.as_secs()).unwrap_or(i64::MAX / 2))
}
