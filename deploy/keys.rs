//! `cyclorama keys`: the rig's authority and the keys that it issues.
//!
//! An authority is a folder with a certificate and its private key; a node's keys are a folder with the authority's certificate, the
//! node's and its private key. What a certificate says is [`link::Identity`]'s matter. Files take their names when they are
//! complete, so a daemon that reads them meanwhile finds whole ones.

use crate::cli::{KeysArgs, KeysCommand, KeysInitArgs, KeysIssueArgs, KeysShowArgs};
use crate::error::CommandError;
use crate::output::{note, say};
use link::{AUTHORITY_FILE, CERTIFICATE_FILE, Fingerprint, Identity, KEY_FILE, NodeRole, Trust, utc};
use rcgen::{
    BasicConstraints, CertificateParams, DistinguishedName, DnType, ExtendedKeyUsagePurpose, IsCa, Issuer, KeyPair,
    KeyUsagePurpose,
};
use serde::Serialize;
use std::fs::{DirBuilder, OpenOptions};
use std::io::Write;
use std::num::NonZeroUsize;
use std::os::unix::fs::{DirBuilderExt, OpenOptionsExt};
use std::path::Path;
use time::{Duration, OffsetDateTime};
use x509_parser::pem::Pem;

/// The authority's private key, in its folder only.
const AUTHORITY_KEY_FILE: &str = "authority.key.pem";
/// Certificates hold from a little before they are made: machines' clocks differ.
const SLACK: Duration = Duration::HOUR;
/// Where `keys DIR` keeps the authority.
const AUTHORITY_FOLDER: &str = "authority";
/// How long that authority holds: ten years, as by `keys init`.
const AUTHORITY_DAYS: u32 = 3650;
/// How many boards `keys DIR` makes keys for.
const BOARDS: usize = 3;
const SECRET: u32 = 0o600;
const PUBLIC: u32 = 0o644;

/// What keys can be issued with.
pub(crate) struct Authority {
    issuer: Issuer<'static, KeyPair>,
    certificate: String,
}

impl Authority {
    /// Makes one in `folder`, which must not have one.
    fn make(folder: &Path, days: u32) -> Result<(), CommandError> {
        for name in [AUTHORITY_FILE, AUTHORITY_KEY_FILE] {
            if folder.join(name).exists() {
                let what = "this is an authority already; replaced, all keys that it has issued would be void. Choose another folder";
                return Err(CommandError::file(&folder.join(name), what));
            }
        }
        let key = KeyPair::generate().map_err(failed)?;
        // Two authorities are told apart by people too.
        let mark = Fingerprint::of(key.public_key_raw()).to_string();
        let mut params = CertificateParams::default();
        params.distinguished_name = called(&format!("cyclorama authority {}", &mark[..8]));
        params.is_ca = IsCa::Ca(BasicConstraints::Constrained(0));
        params.key_usages = vec![KeyUsagePurpose::KeyCertSign, KeyUsagePurpose::CrlSign];
        hold(&mut params, days);
        let certificate = params.self_signed(&key).map_err(failed)?.pem();
        make_folder(folder)?;
        write(&folder.join(AUTHORITY_KEY_FILE), &key.serialize_pem(), SECRET)?;
        write(&folder.join(AUTHORITY_FILE), &certificate, PUBLIC)
    }

    /// Reads one.
    pub(crate) fn open(folder: &Path) -> Result<Self, CommandError> {
        let (file, key_file) = (folder.join(AUTHORITY_FILE), folder.join(AUTHORITY_KEY_FILE));
        let certificate = read(&file)?;
        let key = KeyPair::from_pem(&read(&key_file)?).map_err(|error| CommandError::file(&key_file, error))?;
        let parsed = parse(&file, &certificate)?;
        let is_its_key = parsed
            .first()
            .and_then(|pem| pem.parse_x509().ok())
            .is_some_and(|found| found.public_key().subject_public_key.data.as_ref() == key.public_key_raw());
        if !is_its_key {
            return Err(CommandError::file(
                &key_file,
                format!("this key is not the one of {AUTHORITY_FILE} beside it"),
            ));
        }
        let issuer = Issuer::from_ca_cert_pem(&certificate, key).map_err(|error| CommandError::file(&file, error))?;
        Ok(Self { issuer, certificate })
    }

    /// Issues keys into `folder`, in place of older ones of the same node.
    pub(crate) fn issue(&self, role: NodeRole, name: &str, days: u32, folder: &Path) -> Result<(), CommandError> {
        refuse_another(folder, role, name)?;
        let names = vec![role.role_name(), role.node_name(name)];
        let mut params = CertificateParams::new(names).map_err(failed)?;
        params.distinguished_name = called(&format!("{role} {name}"));
        params.is_ca = IsCa::ExplicitNoCa;
        params.key_usages = vec![KeyUsagePurpose::DigitalSignature];
        // Boards open links and take them.
        params.extended_key_usages = vec![ExtendedKeyUsagePurpose::ServerAuth, ExtendedKeyUsagePurpose::ClientAuth];
        params.use_authority_key_identifier_extension = true;
        hold(&mut params, days);
        let key = KeyPair::generate().map_err(failed)?;
        let certificate = params.signed_by(&key, &self.issuer).map_err(failed)?.pem();
        make_folder(folder)?;
        write(&folder.join(AUTHORITY_FILE), &self.certificate, PUBLIC)?;
        write(&folder.join(KEY_FILE), &key.serialize_pem(), SECRET)?;
        write(&folder.join(CERTIFICATE_FILE), &certificate, PUBLIC)
    }
}

/// `cyclorama keys`.
pub(crate) fn run(args: &KeysArgs) -> Result<(), CommandError> {
    match (&args.command, &args.folder) {
        (Some(KeysCommand::Init(args)), _) => init(args),
        (Some(KeysCommand::Issue(args)), _) => issue(args),
        (Some(KeysCommand::Show(args)), _) => show(args),
        (None, Some(folder)) => make_rig(args, folder),
        (None, None) => Err(CommandError::said("keys of which rig? Say `cyclorama keys FOLDER`")),
    }
}

/// `cyclorama keys DIR`: what is missing of a rig's keys.
fn make_rig(args: &KeysArgs, folder: &Path) -> Result<(), CommandError> {
    let home = folder.join(AUTHORITY_FOLDER);
    if !home.join(AUTHORITY_FILE).exists() {
        // Nodes' keys without the authority beside them are another's, or an authority that is kept elsewhere.
        Authority::make(&home, AUTHORITY_DAYS)?;
        note(&format!("{}: an authority; who has this folder can issue keys for any node", home.display()));
    }
    let authority = Authority::open(&home)?;
    let count = args.boards.map_or(BOARDS, NonZeroUsize::get);
    let numbered = (1..=count).map(|k| format!("board-{k}"));
    let boards: Vec<_> = if args.board.is_empty() { numbered.collect() } else { args.board.clone() };
    let boards = boards.iter().map(|name| (NodeRole::Board, name.as_str()));
    for (role, name) in [(NodeRole::Manager, "manager"), (NodeRole::Compositor, "compositor")].into_iter().chain(boards)
    {
        let node = folder.join(name);
        if node.join(CERTIFICATE_FILE).exists() && !args.renew {
            // Whatever is wrong with it is told now, not when the rig starts.
            Trust::with_keys(&node, role)?;
            note(&format!("{}: kept", node.display()));
        } else {
            authority.issue(role, name, args.days, &node)?;
            note(&format!("{}: keys of the {role} {name}, for {} days", node.display(), args.days));
        }
    }
    Ok(())
}

/// `cyclorama keys init`.
fn init(args: &KeysInitArgs) -> Result<(), CommandError> {
    Authority::make(&args.folder, args.days)?;
    let folder = args.folder.display();
    note(&format!("{folder}: an authority; next: cyclorama keys issue {folder} --role manager --name desk --out desk"));
    Ok(())
}

/// `cyclorama keys issue`.
fn issue(args: &KeysIssueArgs) -> Result<(), CommandError> {
    let role = NodeRole::from(args.role);
    Authority::open(&args.authority)?.issue(role, &args.name, args.days, &args.out)?;
    note(&format!("{}: keys of the {role} {}, for {} days", args.out.display(), args.name, args.days));
    Ok(())
}

/// A certificate, for people and for JSON.
#[derive(Debug, Serialize)]
struct Shown {
    file: &'static str,
    name: String,
    from: String,
    until: String,
    /// SHA-256 of the certificate.
    fingerprint: String,
}

/// `cyclorama keys show`.
fn show(args: &KeysShowArgs) -> Result<(), CommandError> {
    let is_authority = args.folder.join(AUTHORITY_KEY_FILE).exists();
    let files: &[_] = if is_authority { &[AUTHORITY_FILE] } else { &[AUTHORITY_FILE, CERTIFICATE_FILE] };
    let mut shown = Vec::new();
    for file in files {
        shown.extend(describe(&args.folder, file)?);
    }
    if args.json {
        let text = serde_json::to_string(&shown).map_err(|error| CommandError::said(error.to_string()))?;
        say(&text);
    } else {
        for Shown { file, name, from, until, fingerprint } in &shown {
            say(&format!("{file}: {name}\n  valid {from} to {until}\n  SHA-256 {fingerprint}"));
        }
    }
    // Whatever is wrong with them is the command's error.
    if is_authority {
        return Authority::open(&args.folder).map(drop);
    }
    let node = parse(&args.folder.join(CERTIFICATE_FILE), &read(&args.folder.join(CERTIFICATE_FILE))?)?;
    let identity = node.first().and_then(|pem| Identity::of(&pem.contents[..].into()));
    let no_node = || CommandError::file(&args.folder.join(CERTIFICATE_FILE), "it names no node of a rig");
    Trust::with_keys(&args.folder, identity.ok_or_else(no_node)?.role)?;
    Ok(())
}

fn describe(folder: &Path, file: &'static str) -> Result<Vec<Shown>, CommandError> {
    let path = folder.join(file);
    let mut shown = Vec::new();
    for pem in parse(&path, &read(&path)?)? {
        let found = pem.parse_x509().map_err(|error| CommandError::file(&path, error))?;
        let common = found.subject().iter_common_name().next().and_then(|name| name.as_str().ok());
        let name = Identity::of(&pem.contents[..].into()).map(|identity| identity.to_string());
        shown.push(Shown {
            file,
            name: name.or_else(|| common.map(str::to_owned)).unwrap_or_else(|| "without a name".into()),
            from: utc(found.validity().not_before.timestamp()),
            until: utc(found.validity().not_after.timestamp()),
            fingerprint: Fingerprint::of(&pem.contents).to_string(),
        });
    }
    Ok(shown)
}

/// Keys of one node over those of another are a slip, and the other's would be gone.
fn refuse_another(folder: &Path, role: NodeRole, name: &str) -> Result<(), CommandError> {
    if folder.join(AUTHORITY_KEY_FILE).exists() {
        return Err(CommandError::file(
            folder,
            "this is the authority's folder; give the node's keys one of their own",
        ));
    }
    let file = folder.join(CERTIFICATE_FILE);
    if !file.exists() {
        return Ok(());
    }
    let found = parse(&file, &read(&file)?)?.first().and_then(|pem| Identity::of(&pem.contents[..].into()));
    match found {
        Some(found) if (found.role, found.name.as_str()) == (role, name) => Ok(()),
        Some(found) => {
            Err(CommandError::file(folder, format!("these are the keys of the {found}; choose another folder")))
        }
        None => Err(CommandError::file(&file, "this is something else; choose another folder")),
    }
}

fn called(name: &str) -> DistinguishedName {
    let mut called = DistinguishedName::new();
    called.push(DnType::CommonName, name);
    called
}

fn hold(params: &mut CertificateParams, days: u32) {
    let now = OffsetDateTime::now_utc();
    (params.not_before, params.not_after) = (now - SLACK, now + Duration::days(days.into()));
}

fn failed(error: rcgen::Error) -> CommandError {
    CommandError::said(format!("cannot make a certificate: {error}"))
}

fn parse(file: &Path, text: &str) -> Result<Vec<Pem>, CommandError> {
    let found: Result<Vec<_>, _> = Pem::iter_from_buffer(text.as_bytes()).collect();
    match found {
        Ok(found) if found.is_empty() => Err(CommandError::file(file, "no certificate in it")),
        found => found.map_err(|error| CommandError::file(file, error)),
    }
}

fn read(file: &Path) -> Result<String, CommandError> {
    let hint = |error| CommandError::file(file, format!("{error}; `cyclorama keys --help` tells how keys are made"));
    std::fs::read_to_string(file).map_err(hint)
}

fn make_folder(folder: &Path) -> Result<(), CommandError> {
    let made = DirBuilder::new().recursive(true).mode(0o700).create(folder);
    made.map_err(|error| CommandError::file(folder, error))
}

/// Writes beside the file's place, then gives it its name.
fn write(file: &Path, text: &str, mode: u32) -> Result<(), CommandError> {
    let part = file.with_extension("part");
    // One that was left behind may have another mode.
    let _ = std::fs::remove_file(&part);
    let written = OpenOptions::new().write(true).create_new(true).mode(mode).open(&part).and_then(|mut opened| {
        opened.write_all(text.as_bytes())?;
        opened.sync_all()?;
        std::fs::rename(&part, file)
    });
    written.map_err(|error| CommandError::file(file, error))
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Parser;
    use std::os::unix::fs::PermissionsExt;

    #[test]
    fn issued_keys_can_be_used_and_only_their_owner_reads_them() {
        let folder = tempfile::tempdir().unwrap();
        let (authority, node) = (folder.path().join("authority"), folder.path().join("pc1"));
        Authority::make(&authority, 10).unwrap();
        Authority::open(&authority).unwrap().issue(NodeRole::Board, "pc1", 5, &node).unwrap();
        assert!(Trust::with_keys(&node, NodeRole::Board).unwrap().has_keys());
        for file in [node.join(KEY_FILE), authority.join(AUTHORITY_KEY_FILE)] {
            assert_eq!(std::fs::metadata(file).unwrap().permissions().mode() & 0o777, SECRET);
        }
        let shown = describe(&node, CERTIFICATE_FILE).unwrap();
        assert_eq!(shown[0].name, "board pc1");
        assert!(describe(&authority, AUTHORITY_FILE).unwrap()[0].name.starts_with("cyclorama authority "));
        show(&KeysShowArgs { folder: node, json: true }).unwrap();
        show(&KeysShowArgs { folder: authority, json: false }).unwrap();
    }

    #[test]
    fn one_command_makes_a_rigs_keys_and_adds_what_is_missing() {
        let folder = tempfile::tempdir().unwrap();
        let rig = folder.path().join("rig");
        let make = |more: &[&str]| {
            let line = [&["cyclorama", "keys", rig.to_str().unwrap()], more].concat();
            match crate::cli::Cli::try_parse_from(line).unwrap().command {
                Some(crate::cli::Command::Keys(args)) => run(&args).map_err(|error| error.to_string()),
                _ => unreachable!("that is the command"),
            }
        };
        let certificate = |node: &str| std::fs::read(rig.join(node).join(CERTIFICATE_FILE)).unwrap();
        make(&["--boards", "2"]).unwrap();
        for (node, role) in
            [("manager", NodeRole::Manager), ("compositor", NodeRole::Compositor), ("board-2", NodeRole::Board)]
        {
            assert!(Trust::with_keys(&rig.join(node), role).unwrap().has_keys());
        }
        assert!(!rig.join("board-3").exists());
        let (first, authority) =
            (certificate("board-1"), std::fs::read(rig.join("authority").join(AUTHORITY_FILE)).unwrap());
        make(&["--boards", "3"]).unwrap();
        make(&["--board", "pc1,left-wall"]).unwrap();
        assert_eq!(certificate("board-1"), first, "kept");
        assert!(Trust::with_keys(&rig.join("left-wall"), NodeRole::Board).is_ok());
        make(&["--renew", "--boards", "1"]).unwrap();
        assert_ne!(certificate("board-1"), first, "renewed");
        assert_eq!(std::fs::read(rig.join("authority").join(AUTHORITY_FILE)).unwrap(), authority, "the same authority");
        // A board's keys where the manager's should be.
        std::fs::remove_dir_all(rig.join("manager")).unwrap();
        std::fs::rename(rig.join("board-1"), rig.join("manager")).unwrap();
        let error = make(&[]).unwrap_err();
        assert!(error.contains("this certificate is for the board board-1, and a manager needs"), "{error}");
    }

    #[test]
    fn nothing_of_value_is_overwritten() {
        let folder = tempfile::tempdir().unwrap();
        let (first, node) = (folder.path().join("authority"), folder.path().join("pc1"));
        Authority::make(&first, 10).unwrap();
        let error = Authority::make(&first, 10).unwrap_err().to_string();
        assert!(error.contains("authority.pem: this is an authority already"), "{error}");
        let authority = Authority::open(&first).unwrap();
        authority.issue(NodeRole::Board, "pc1", 5, &node).unwrap();
        authority.issue(NodeRole::Board, "pc1", 5, &node).unwrap();
        let error = authority.issue(NodeRole::Board, "pc2", 5, &node).unwrap_err().to_string();
        assert!(error.contains("these are the keys of the board pc1; choose another folder"), "{error}");
        let error = authority.issue(NodeRole::Board, "pc2", 5, &first).unwrap_err().to_string();
        assert!(error.contains("this is the authority's folder"), "{error}");
    }

    #[test]
    fn an_authority_with_another_ones_key_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let [one, two] = ["one", "two"].map(|name| folder.path().join(name));
        Authority::make(&one, 10).unwrap();
        Authority::make(&two, 10).unwrap();
        std::fs::copy(one.join(AUTHORITY_KEY_FILE), two.join(AUTHORITY_KEY_FILE)).unwrap();
        let error = Authority::open(&two).err().unwrap().to_string();
        assert!(error.contains("authority.key.pem: this key is not the one of authority.pem"), "{error}");
    }
}
