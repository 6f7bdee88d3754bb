//! Handshakes over loopback, with keys made for each test.

use crate::{
    AUTHORITY_FILE, Arrival, CERTIFICATE_FILE, Expected, Fingerprint, Identity, KEY_FILE, Listener, NodeRole, Stream,
    Trust, is_node_name,
};
use proto::link::LinkError;
use rcgen::{BasicConstraints, CertificateParams, IsCa, Issuer, KeyPair};
use rustls::pki_types::pem::PemObject;
use rustls::pki_types::{CertificateDer, PrivateKeyDer};
use rustls::{ClientConfig, RootCertStore};
use std::net::SocketAddr;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;
use tempfile::TempDir;
use time::OffsetDateTime;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpStream;

struct Authority {
    issuer: Issuer<'static, KeyPair>,
    pem: String,
}

impl Authority {
    fn new() -> Self {
        let mut params = CertificateParams::default();
        params.is_ca = IsCa::Ca(BasicConstraints::Constrained(0));
        let key = KeyPair::generate().unwrap();
        let pem = params.self_signed(&key).unwrap().pem();
        Self { issuer: Issuer::new(params, key), pem }
    }

    /// Keys of these names in a folder; valid from and to so many days from now.
    fn issue_into(&self, folder: &Path, names: &[String], days: [i64; 2]) {
        let mut params = CertificateParams::new(names.to_vec()).unwrap();
        let [from, to] = days.map(|days| OffsetDateTime::now_utc() + time::Duration::days(days));
        (params.not_before, params.not_after) = (from, to);
        let key = KeyPair::generate().unwrap();
        let certificate = params.signed_by(&key, &self.issuer).unwrap();
        std::fs::write(folder.join(AUTHORITY_FILE), &self.pem).unwrap();
        std::fs::write(folder.join(CERTIFICATE_FILE), certificate.pem()).unwrap();
        std::fs::write(folder.join(KEY_FILE), key.serialize_pem()).unwrap();
    }

    fn issue(&self, role: NodeRole, name: &str) -> TempDir {
        let folder = tempfile::tempdir().unwrap();
        self.issue_into(folder.path(), &names(role, name), [-1, 1]);
        folder
    }

    fn trust(&self, role: NodeRole, name: &str) -> Trust {
        Trust::with_keys(self.issue(role, name).path(), role).unwrap()
    }
}

fn names(role: NodeRole, name: &str) -> Vec<String> {
    vec![role.role_name(), role.node_name(name)]
}

fn any_port() -> SocketAddr {
    SocketAddr::from(([127, 0, 0, 1], 0))
}

/// What both sides get of one attempt: who the server's peer is, and who the client's.
async fn meet(server: Trust, client: Trust, expected: Expected) -> [Result<Option<Identity>, String>; 2] {
    let mut listener = Listener::bind(any_port(), server).await.unwrap();
    let address = listener.local_addr().unwrap().to_string();
    let accepting = async {
        let Arrival::Peer(incoming) = listener.next().await else { panic!("it is let in") };
        let greeting = |mut stream: Stream| async move {
            stream.write_all(b"x").await?;
            stream.flush().await?;
            let peer = stream.peer().cloned();
            // Until the other side has had its say.
            stream.read_u8().await?;
            Ok::<_, LinkError>(peer)
        };
        incoming.greet(Duration::from_secs(5), greeting).await.map(|(peer, _)| peer).map_err(|e| e.to_string())
    };
    let connecting = async {
        let mut stream = client.connect(&address, &expected).await.map_err(|e| e.to_string())?;
        stream.write_all(b"y").await.map_err(|e| e.to_string())?;
        stream.flush().await.map_err(|e| e.to_string())?;
        stream.read_u8().await.map_err(|e| e.to_string())?;
        Ok(stream.peer().cloned())
    };
    let (accepted, connected) = tokio::join!(accepting, connecting);
    [accepted, connected]
}

fn any_manager() -> Expected {
    Expected::any(NodeRole::Manager)
}

#[tokio::test]
async fn both_sides_learn_who_the_other_is() {
    let rig = Authority::new();
    let (manager, board) = (rig.trust(NodeRole::Manager, "desk"), rig.trust(NodeRole::Board, "pc1"));
    let fingerprint = board.identity().await.unwrap().fingerprint;
    let [accepted, connected] = meet(manager, board, any_manager()).await;
    let accepted = accepted.unwrap().unwrap();
    assert_eq!(accepted, Identity { role: NodeRole::Board, name: "pc1".into(), fingerprint });
    assert_eq!(connected.unwrap().unwrap().to_string(), "manager desk");
}

#[tokio::test]
async fn without_keys_nobody_is_known_and_loopback_is_fine() {
    let [accepted, connected] = meet(Trust::LOOPBACK, Trust::LOOPBACK, any_manager()).await;
    assert_eq!((accepted, connected), (Ok(None), Ok(None)));
    assert!(!Trust::LOOPBACK.may_reach("10.0.0.1".parse().unwrap()));
    assert!(Trust::LOOPBACK.may_reach("::ffff:127.0.0.1".parse().unwrap()));
    assert!(Trust::INSECURE.may_reach("10.0.0.1".parse().unwrap()));
}

#[tokio::test]
async fn keys_of_another_rig_are_refused_on_both_sides() {
    let (ours, theirs) = (Authority::new(), Authority::new());
    let [accepted, connected] =
        meet(ours.trust(NodeRole::Manager, "desk"), theirs.trust(NodeRole::Board, "pc1"), any_manager()).await;
    assert!(accepted.unwrap_err().contains("authority"), "the server says so");
    assert_eq!(connected.unwrap_err(), "its certificate is of another rig's authority");
}

#[tokio::test]
async fn roles_that_have_no_business_are_refused_and_told() {
    let rig = Authority::new();
    let [accepted, connected] = meet(
        rig.trust(NodeRole::Compositor, "wall"),
        rig.trust(NodeRole::Compositor, "other"),
        Expected::any(NodeRole::Compositor),
    )
    .await;
    assert_eq!(accepted.unwrap_err(), "its certificate is of a role that has no business here");
    let told = connected.unwrap_err();
    assert!(told.contains("our certificate is of a role that has no business there"), "{told}");
}

#[tokio::test]
async fn a_board_does_not_pass_for_a_manager_nor_for_another_board() {
    let rig = Authority::new();
    let (one, two) = (rig.trust(NodeRole::Board, "pc1"), rig.trust(NodeRole::Board, "pc2"));
    let [_, connected] = meet(one.clone(), two.clone(), any_manager()).await;
    assert_eq!(connected.unwrap_err(), "its certificate is for board.rig and pc1.board.rig, not for manager.rig");
    let third = Expected { role: NodeRole::Board, name: Some("pc3".into()) };
    let [_, connected] = meet(one.clone(), two.clone(), third).await;
    assert!(connected.unwrap_err().contains("not for pc3.board.rig"));
    let first = Expected { role: NodeRole::Board, name: Some("pc1".into()) };
    assert!(meet(one, two, first).await[1].is_ok());
}

#[tokio::test]
async fn with_and_without_keys_do_not_understand_each_other_and_say_so() {
    let rig = Authority::new();
    let [accepted, _] = meet(rig.trust(NodeRole::Manager, "desk"), Trust::LOOPBACK, any_manager()).await;
    assert_eq!(accepted.unwrap_err(), "it doesn't speak TLS; start it with keys of this rig (--keys)");
    let [_, connected] = meet(Trust::LOOPBACK, rig.trust(NodeRole::Board, "pc1"), any_manager()).await;
    assert_eq!(connected.unwrap_err(), "it doesn't speak TLS; start it with keys of this rig (--keys)");
}

#[tokio::test]
async fn new_keys_are_used_from_the_next_handshake_on_and_bad_ones_never() {
    let rig = Authority::new();
    let folder = rig.issue(NodeRole::Board, "pc1");
    let board = Trust::with_keys(folder.path(), NodeRole::Board).unwrap();
    let before = board.identity().await.unwrap();
    std::fs::write(folder.path().join(KEY_FILE), "rubbish").unwrap();
    assert_eq!(board.identity().await.unwrap(), before);
    rig.issue_into(folder.path(), &names(NodeRole::Board, "pc1"), [-1, 1]);
    let manager = rig.trust(NodeRole::Manager, "desk");
    let [accepted, _] = meet(manager, board, any_manager()).await;
    let accepted = accepted.unwrap().unwrap();
    assert_eq!(accepted.name, before.name);
    assert_ne!(accepted.fingerprint, before.fingerprint);
}

#[tokio::test]
async fn a_rig_changes_its_authority_with_both_in_the_file_meanwhile() {
    let (old, new) = (Authority::new(), Authority::new());
    let [manager, board] = [(&old, NodeRole::Manager), (&new, NodeRole::Board)].map(|(authority, role)| {
        let folder = authority.issue(role, "node");
        std::fs::write(folder.path().join(AUTHORITY_FILE), format!("{}{}", old.pem, new.pem)).unwrap();
        Trust::with_keys(folder.path(), role).unwrap()
    });
    let met = meet(manager, board, any_manager()).await;
    assert!(met.iter().all(Result::is_ok), "{met:?}");
}

#[tokio::test]
async fn a_handshake_that_stalls_ends() {
    let rig = Authority::new();
    let mut listener = Listener::bind(any_port(), rig.trust(NodeRole::Manager, "desk")).await.unwrap();
    let address = listener.local_addr().unwrap();
    let mut stalled = TcpStream::connect(address).await.unwrap();
    // The head of a record that never comes.
    stalled.write_all(&[22, 3, 1, 2, 0]).await.unwrap();
    let Arrival::Peer(incoming) = listener.next().await else { panic!("it is let in") };
    let greeting = |_: Stream| async { Ok::<_, LinkError>(()) };
    let error = incoming.greet(Duration::from_millis(50), greeting).await.unwrap_err();
    assert_eq!(error.to_string(), "it didn't say who it is in time");
}

/// A client that doesn't look at its own keys.
fn client_unchecked(folder: &Path) -> Arc<ClientConfig> {
    let read = |name: &str| std::fs::read(folder.join(name)).unwrap();
    let mut roots = RootCertStore::empty();
    roots.add(CertificateDer::from_pem_slice(&read(AUTHORITY_FILE)).unwrap()).unwrap();
    let certificate = CertificateDer::from_pem_slice(&read(CERTIFICATE_FILE)).unwrap();
    let key = PrivateKeyDer::from_pem_slice(&read(KEY_FILE)).unwrap();
    let config = ClientConfig::builder_with_provider(Arc::new(rustls::crypto::ring::default_provider()))
        .with_protocol_versions(&[&rustls::version::TLS13])
        .unwrap()
        .with_root_certificates(roots);
    Arc::new(config.with_client_auth_cert(vec![certificate], key).unwrap())
}

/// Connects with a certificate that its own program would refuse to start with, and returns what the other side makes of it.
async fn knock_with(names: &[String], days: [i64; 2]) -> String {
    let rig = Authority::new();
    let folder = tempfile::tempdir().unwrap();
    rig.issue_into(folder.path(), names, days);
    let client = client_unchecked(folder.path());
    let mut listener = Listener::bind(any_port(), rig.trust(NodeRole::Manager, "desk")).await.unwrap();
    let address = listener.local_addr().unwrap();
    let accepting = async {
        let Arrival::Peer(incoming) = listener.next().await else { panic!("it is let in") };
        let greeting = |_: Stream| async { Ok::<_, LinkError>(()) };
        incoming.greet(Duration::from_secs(5), greeting).await.map(drop).unwrap_err().to_string()
    };
    let connecting = async {
        let stream = TcpStream::connect(address).await.unwrap();
        let name = "manager.rig".try_into().unwrap();
        // In TLS 1.3 the client is done before the server has looked at its certificate.
        let mut stream = tokio_rustls::TlsConnector::from(client).connect(name, stream).await.unwrap();
        stream.read_u8().await.unwrap_err().to_string()
    };
    let (refusal, told) = tokio::join!(accepting, connecting);
    assert!(told.contains("alert"), "the peer is told: {told}");
    refusal
}

#[tokio::test]
async fn peers_are_refused_for_certificates_out_of_their_time_and_without_a_node() {
    let board = names(NodeRole::Board, "pc1");
    let refusal = knock_with(&board, [-2, -1]).await;
    assert!(refusal.starts_with("its certificate has expired on 20"), "{refusal}");
    let refusal = knock_with(&board, [1, 2]).await;
    assert!(refusal.starts_with("its certificate is not valid before 20"), "{refusal}");
    let refusal = knock_with(&["www.example.org".into()], [-1, 1]).await;
    assert_eq!(refusal, "its certificate is of a role that has no business here");
}

#[test]
fn keys_that_cannot_be_used_are_named_with_file_and_reason() {
    let rig = Authority::new();
    let board = names(NodeRole::Board, "pc1");
    let folder = tempfile::tempdir().unwrap();
    let open = |role| Trust::with_keys(folder.path(), role).unwrap_err().to_string();
    let file = |name: &str| folder.path().join(name).display().to_string();

    let error = open(NodeRole::Board);
    assert!(error.starts_with(&file(AUTHORITY_FILE)) && error.contains("cyclorama keys issue"), "{error}");
    rig.issue_into(folder.path(), &board, [-2, -1]);
    let error = open(NodeRole::Board);
    assert!(error.starts_with(&file(CERTIFICATE_FILE)) && error.contains("has expired on 20"), "{error}");
    rig.issue_into(folder.path(), &board, [1, 2]);
    assert!(open(NodeRole::Board).contains("is not valid before 20"));
    rig.issue_into(folder.path(), &board, [-1, 1]);
    assert!(Trust::with_keys(folder.path(), NodeRole::Board).is_ok());
    let error = open(NodeRole::Manager);
    assert!(error.contains("is for the board pc1, and a manager needs one of role manager"), "{error}");

    std::fs::write(folder.path().join(AUTHORITY_FILE), Authority::new().pem).unwrap();
    assert!(open(NodeRole::Board).contains("not of the authority in authority.pem"));
    std::fs::write(folder.path().join(AUTHORITY_FILE), &rig.pem).unwrap();
    std::fs::write(folder.path().join(KEY_FILE), KeyPair::generate().unwrap().serialize_pem()).unwrap();
    let error = open(NodeRole::Board);
    assert!(error.starts_with(&file(KEY_FILE)) && error.contains("not the one of certificate.pem"), "{error}");
    std::fs::write(folder.path().join(CERTIFICATE_FILE), "").unwrap();
    assert!(open(NodeRole::Board).contains("no certificate in it"));
}

#[test]
fn only_certificates_of_exactly_one_node_have_an_identity() {
    let rig = Authority::new();
    let identity = |names: &[&str]| {
        let folder = tempfile::tempdir().unwrap();
        rig.issue_into(folder.path(), &names.iter().map(|n| (*n).to_owned()).collect::<Vec<_>>(), [-1, 1]);
        let pem = std::fs::read(folder.path().join(CERTIFICATE_FILE)).unwrap();
        let der = CertificateDer::from_pem_slice(&pem);
        Identity::of(&der.unwrap()).map(|identity| identity.to_string())
    };
    assert_eq!(identity(&["board.rig", "pc1.board.rig"]).as_deref(), Some("board pc1"));
    for bad in [
        &["board.rig"][..],
        &["pc1.board.rig"],
        &["board.rig", "pc1.compositor.rig"],
        &["board.rig", "compositor.rig", "pc1.board.rig"],
        &["board.rig", "a.pc1.board.rig"],
        &["host.rig", "pc1.host.rig"],
        &["example.org", "www.example.org"],
    ] {
        assert_eq!(identity(bad), None, "{bad:?}");
    }
}

#[test]
fn names_of_nodes_are_labels() {
    for good in ["pc1", "left-3", "0", &"x".repeat(63)] {
        assert!(is_node_name(good), "{good}");
    }
    for bad in ["", "PC1", "a.b", "-a", "a-", "ü", "a b", "a_b", &"x".repeat(64)] {
        assert!(!is_node_name(bad), "{bad}");
    }
    let empty = "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855";
    assert_eq!(Fingerprint::of(b"").to_string(), empty);
}

/// A machine that is gone says nothing, and the system would try for minutes.
#[tokio::test]
async fn who_does_not_answer_a_connection_is_given_up_soon() {
    // A listener whose queue is full answers nobody.
    let socket = tokio::net::TcpSocket::new_v4().unwrap();
    socket.bind("127.0.0.1:0".parse().unwrap()).unwrap();
    let listener = socket.listen(1).unwrap();
    let address = listener.local_addr().unwrap().to_string();
    let mut queued = Vec::new();
    let error = loop {
        match Trust::LOOPBACK.connect(&address, &Expected::any(NodeRole::Manager)).await {
            Ok(stream) => queued.push(stream),
            Err(error) => break error,
        }
        assert!(queued.len() < 100, "the queue is endless");
    };
    assert_eq!(error.kind(), std::io::ErrorKind::TimedOut, "{error}");
}
