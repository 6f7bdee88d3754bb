//! From flags, environment and rig file to the configuration that runs: flags win over environment (clap sees to
//! that), both win over the file, and the defaults are here.

use crate::cli::{AirArgs, Console, DetailArg, ManagerArgs, ModeArg, RowArgs, TrustArgs};
use crate::error::CommandError;
use crate::rig_file::{Air, RigFile, SamplesEntry, ViewEntry};
use crate::source;
use glam::{DQuat, DVec3};
use link::{NodeRole, Trust};
use manager::backplane::{Config, DefaultRow, Stage, Token};
use manager::host::camera::{CameraFile, FOV_DEFAULT_DEG};
use manager::scene::Scene;
use manager::select::DetailMode;
use proto::chain::ClockMode;
use proto::frame::{Background, Environment};
use proto::limits;
use proto::view::{Mode, Pose, Samples, Tangents, View, ViewSetup};
use std::net::{IpAddr, Ipv4Addr, SocketAddr, ToSocketAddrs};
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

/// Default number of views.
pub(crate) const VIEWS: u32 = 3;
/// Default size of a view, pixels.
pub(crate) const SIZE: (u32, u32) = (1280, 720);
/// Default points per pixel.
pub(crate) const SAMPLES: Samples = Samples::Sixteen;
const RATE_HZ: f64 = 60.0;
/// Enough for all displays of a busy machine to have the last tiles and to be awake.
const SWAP_LEAD_MS: f64 = 3.0;
/// How far resolution may fall: half each way can be looked at, a quarter is for those who ask.
const LOWEST_RESOLUTION: u32 = 2;
const PORT_BACKPLANE: u16 = 7400;
const PORT_POSE: u16 = 7401;
/// How far above a manager's a stand-by's ports are, so that both can be on one machine.
const PORTS_STANDBY: u16 = 10;
/// Default port of the console.
pub(crate) const PORT_CONSOLE: u16 = 7480;

/// An address on this machine.
pub(crate) fn loopback(port: u16) -> SocketAddr {
    SocketAddr::new(IpAddr::V4(Ipv4Addr::LOCALHOST), port)
}

/// How a daemon's links are protected.
pub(crate) fn trust(args: &TrustArgs, role: NodeRole) -> Result<Trust, CommandError> {
    match &args.keys {
        Some(folder) => Ok(Trust::with_keys(folder, role)?),
        None if args.insecure => Ok(Trust::INSECURE),
        None => Ok(Trust::LOOPBACK),
    }
}

/// Refuses to take links at an address beyond this machine without keys, unless it was asked for in so many words.
pub(crate) fn guard_listen(address: SocketAddr, trust: &Trust) -> Result<SocketAddr, CommandError> {
    if trust.may_reach(address.ip()) { Ok(address) } else { Err(unprotected(address)) }
}

/// Likewise to open a link. A name that can't be resolved yet is looked at again when it is used.
pub(crate) fn guard_peer(address: &str, trust: &Trust) -> Result<String, CommandError> {
    let is_beyond = |address: SocketAddr| !trust.may_reach(address.ip());
    // With keys nothing is asked of a name server that may not be up yet.
    if !trust.has_keys() && address.to_socket_addrs().into_iter().flatten().any(is_beyond) {
        return Err(unprotected(address));
    }
    Ok(address.to_owned())
}

/// The backplanes that a daemon connects to.
pub(crate) fn backplanes(addresses: &[String], trust: &Trust) -> Result<Vec<String>, CommandError> {
    let addresses = addresses.iter().map(|address| guard_peer(address, trust)).collect::<Result<Vec<_>, _>>()?;
    match &addresses[..] {
        [_] => Ok(addresses),
        [first, second] if first != second => Ok(addresses),
        [first, _] => Err(CommandError::said(format!("--backplane {first} is given twice; give the stand-by's"))),
        _ => Err(CommandError::said(format!(
            "{} backplanes; there can be two: one leads, and one stands by",
            addresses.len()
        ))),
    }
}

/// For whom a manager stands by, if it does.
fn stands_by_for(args: &ManagerArgs, file: &RigFile, trust: &Trust) -> Result<Option<String>, CommandError> {
    let Some(given) = &args.standby else { return Ok(None) };
    let leader = file.ports.backplane.unwrap_or(loopback(PORT_BACKPLANE));
    if given.is_empty() && leader.ip().is_unspecified() {
        return Err(CommandError::said(format!(
            "the rig file's manager listens at {leader}, which doesn't say where it is: give its address, --standby HOST:PORT"
        )));
    }
    let address = if given.is_empty() { leader.to_string() } else { given.clone() };
    guard_peer(&address, trust).map(Some)
}

fn unprotected(address: impl std::fmt::Display) -> CommandError {
    CommandError::said(format!(
        "{address} is beyond this machine, where links need keys: make them with `cyclorama keys` and give them with --keys, or say \
         --insecure on a network where you trust everybody"
    ))
}

/// Refuses an address beyond this machine for what keys don't protect.
fn guard_open(address: SocketAddr, what: &str, is_insecure: bool) -> Result<(), CommandError> {
    if link::is_on_this_machine(address.ip()) || is_insecure {
        return Ok(());
    }
    Err(CommandError::said(format!(
        "{address} is beyond this machine, and {what} not encrypted, with or without keys; say --insecure on a network where you \
         trust everybody"
    )))
}

/// The default row of views.
pub(crate) fn row(args: &RowArgs, mode: Option<ModeArg>, file: &RigFile) -> Result<DefaultRow, CommandError> {
    let file_samples = file.row.samples.as_ref().map(samples).transpose()?;
    let file_size = file.row.size.map(|[width, height]| (width, height));
    let (width, height) = args.size.or(file_size).unwrap_or(SIZE);
    let count = args.views.or(file.row.views).map_or(VIEWS, std::num::NonZeroU32::get);
    if count as usize > limits::VIEWS_MAX {
        return Err(CommandError::said(format!("{count} views; possible are 1 to {}", limits::VIEWS_MAX)));
    }
    Ok(DefaultRow {
        count,
        width,
        height,
        samples: args.samples.or(file_samples).unwrap_or(SAMPLES),
        mode: mode.map(Mode::from).or(file.row.mode.map(Mode::from)).unwrap_or_default(),
    })
}

fn samples(entry: &SamplesEntry) -> Result<Samples, CommandError> {
    let (found, text) = match entry {
        SamplesEntry::Count(count) => (Samples::from_count(*count), count.to_string()),
        SamplesEntry::Name(name) => (Samples::from_name(name), format!("{name:?}")),
    };
    found.ok_or_else(|| CommandError::said(format!("samples = {text}: possible are {}", Samples::NAMES)))
}

/// Light and air.
pub(crate) fn environment(args: &AirArgs, file: &Air) -> Result<Environment, CommandError> {
    let mut environment = Environment::default();
    let narrow = |rgb: [f64; 3]| rgb.map(|c| c as f32);
    if let Some(rgb) = args.background.or(file.background) {
        environment.background = Background::Constant(narrow(rgb));
    }
    if let Some(sun) = args.sun.or(file.sun) {
        let direction = DVec3::from_array(sun).try_normalize();
        let no_direction = || CommandError::said("the direction towards the sun has no length");
        environment.sun_direction = direction.ok_or_else(no_direction)?;
    }
    environment.visibility_m = args.visibility.or(file.visibility_m);
    if environment.visibility_m.is_some_and(|v| !(v.is_finite() && v > 0.0)) {
        return Err(CommandError::said("the visibility must be above zero"));
    }
    environment.scene_lights = args.scene_lights || file.scene_lights.unwrap_or_default();
    environment.fog = args.fog.or(file.fog).map(narrow);
    Ok(environment)
}

/// The projector that a rig file describes.
pub(crate) fn view(entry: &ViewEntry) -> Result<ViewSetup, CommandError> {
    let [width, height] = entry.size;
    let tangents = match (entry.tangents, entry.vertical_fov_deg) {
        (Some(tangents), None) => tangents,
        (None, fov) => Tangents::symmetric(fov.unwrap_or(FOV_DEFAULT_DEG), width.max(1), height.max(1)),
        (Some(_), Some(_)) => {
            return Err(CommandError::said(format!(
                "view {:?} has both tangents and vertical_fov_deg; keep one",
                entry.name
            )));
        }
    };
    // Yaw to the right, pitch up, roll right side down, in this order.
    let orientation = DQuat::from_rotation_y(-entry.yaw_deg.to_radians())
        * DQuat::from_rotation_x(entry.pitch_deg.to_radians())
        * DQuat::from_rotation_z(-entry.roll_deg.to_radians());
    let view = View {
        offset: Pose { position: DVec3::from_array(entry.offset_m), orientation },
        tangents,
        width,
        height,
        near: entry.near_m.unwrap_or(View::NEAR_DEFAULT),
        samples: entry.samples.as_ref().map(samples).transpose()?.unwrap_or(SAMPLES),
    };
    if view.is_valid() {
        let mode = entry.mode.map(Mode::from).unwrap_or_default();
        Ok(ViewSetup { view, mode, at: entry.at })
    } else {
        let largest = limits::VIEW_SIZE_MAX;
        Err(CommandError::said(format!(
            "view {:?}: sizes must be 1 to {largest} pixels, near_m above zero, left < right and bottom < top",
            entry.name
        )))
    }
}

/// What the manager shows.
pub(crate) fn stage(
    scene: Scene,
    camera: &CameraFile,
    args: &RowArgs,
    mode: Option<ModeArg>,
    detail: Option<DetailArg>,
    air: &AirArgs,
    file: &RigFile,
) -> Result<Stage, CommandError> {
    let first = &camera.poses[0];
    let eye = first.pose().map_err(|error| CommandError::said(error.to_string()))?;
    let environment = environment(air, &file.air)?;
    let (views, row) = if file.views.is_empty() || args.views.is_some() {
        let row = row(args, mode, file)?;
        (row.views(first.lens(row.width, row.height)), Some(row))
    } else {
        let mut views = file.views.iter().map(view).collect::<Result<Vec<_>, _>>()?;
        if let Some(mode) = mode {
            views.iter_mut().for_each(|setup| setup.mode = mode.into());
        }
        (views, None)
    };
    if views.len() > limits::VIEWS_MAX || !views.iter().all(ViewSetup::is_valid) {
        return Err(CommandError::said(format!("{} views; possible are 1 to {}", views.len(), limits::VIEWS_MAX)));
    }
    if ViewSetup::layout(&views).is_none() {
        let largest = limits::STITCHED_SIZE_MAX;
        return Err(CommandError::said(format!(
            "the stitched picture would be larger than {largest} pixels; use smaller views"
        )));
    }
    let detail = detail.map(DetailMode::from).or(file.detail.map(DetailMode::from)).unwrap_or_default();
    Ok(Stage { scene: Arc::new(scene), views, row, environment, detail, eye })
}

/// The manager's configuration.
pub(crate) fn manager(args: &ManagerArgs) -> Result<Config, CommandError> {
    let file = args.rig.as_deref().map(RigFile::read).transpose()?.unwrap_or_default();
    let scene = args.scene.clone().or(file.scene.clone()).unwrap_or_else(|| "airport".into());
    let camera = args.camera.clone().or(file.camera.clone().map(PathBuf::from));
    let (ports, above) = if args.standby.is_some() { (&file.standby, PORTS_STANDBY) } else { (&file.ports, 0) };
    let listen = args.listen.or(ports.backplane).unwrap_or(loopback(PORT_BACKPLANE + above));
    let pose_listen = args.pose_listen.or(ports.pose).unwrap_or(loopback(PORT_POSE + above));
    let console = match (args.console, ports.console) {
        (Some(Console::Off), _) => None,
        (Some(Console::At(address)), _) | (None, Some(address)) => Some(address),
        (None, None) => Some(loopback(PORT_CONSOLE + above)),
    };
    let mut trusting = args.trust.clone();
    trusting.keys = trusting.keys.or(file.keys.clone().map(PathBuf::from));
    let trust = trust(&trusting, NodeRole::Manager)?;
    guard_listen(listen, &trust)?;
    let stands_by_for = stands_by_for(args, &file, &trust)?;
    if stands_by_for.as_ref().is_some_and(|leader| *leader == listen.to_string()) {
        return Err(CommandError::said(format!(
            "this manager listens at {listen} itself; --standby takes the address of the one that leads"
        )));
    }
    guard_open(pose_listen, "pose packets are", trusting.insecure)?;
    if let Some(address) = console {
        guard_open(address, "the console is", trusting.insecure)?;
    }
    let rate = args.rate.or(file.rate_hz).unwrap_or(RATE_HZ);
    if !(rate.is_finite() && (0.01..=10_000.0).contains(&rate)) {
        return Err(CommandError::said(format!("a rate of {rate} Hz; possible are 0.01 to 10 000")));
    }
    let mode = if args.lock_step {
        ClockMode::LockStep
    } else {
        ClockMode::RealTime { period: Duration::from_secs_f64(1.0 / rate) }
    };
    let source = source::load(&scene, camera.as_deref())?;
    Ok(Config {
        stage: stage(source.scene, &source.camera, &args.row, args.mode, args.detail, &args.air, &file)?,
        mode,
        frames: args.frames,
        wait_for_boards: args.wait_for_boards,
        wait_for_compositor: args.wait_for_compositor,
        scale_max: scale_max(args, &file)?,
        swap_lead: swap_lead(args, &file)?,
        select_ahead: args.select_ahead.or(file.select_ahead).unwrap_or_default().into(),
        board_memory: board_memory(args, &file)?,
        trust,
        stands_by_for,
        listen,
        pose_listen,
        console_listen: console,
        console_token: console_token(args, &file)?,
        otlp: otlp(args, &file)?,
        progress: Arc::default(),
    })
}

/// How long before its moment a swap is said to displays.
fn swap_lead(args: &ManagerArgs, file: &RigFile) -> Result<Duration, CommandError> {
    match args.swap_lead.or(file.swap_lead_ms).unwrap_or(SWAP_LEAD_MS) {
        ms if (0.0..=15.0).contains(&ms) => Ok(Duration::from_secs_f64(ms / 1e3)),
        other => Err(CommandError::said(format!("swap_lead_ms is {other}; it can be 0 to 15"))),
    }
}

/// How far resolution may fall.
fn scale_max(args: &ManagerArgs, file: &RigFile) -> Result<u32, CommandError> {
    match args.lowest_resolution.or(file.lowest_resolution).unwrap_or(LOWEST_RESOLUTION) {
        scale @ (1 | 2 | 4) => Ok(scale),
        other => Err(CommandError::said(format!("lowest_resolution is {other}; it can be 1, 2 or 4"))),
    }
}

/// What somebody must know to change anything at the console.
fn console_token(args: &ManagerArgs, file: &RigFile) -> Result<Option<Token>, CommandError> {
    let written = args.observed.console_token.as_ref().or(file.console_token.as_ref());
    written.map(|text| Token::new(text)).transpose().map_err(|error| CommandError::said(error.to_string()))
}

/// Where frames are sent as traces.
fn otlp(args: &ManagerArgs, file: &RigFile) -> Result<Option<String>, CommandError> {
    let url = args.observed.otlp.clone().or(file.otlp.clone());
    if url.is_some() && !cfg!(feature = "otlp") {
        return Err(CommandError::said(
            "this build sends no traces; build it with the feature `otlp`, or leave --otlp away",
        ));
    }
    Ok(url)
}

/// Most memory of each board that is used, bytes.
fn board_memory(args: &ManagerArgs, file: &RigFile) -> Result<u64, CommandError> {
    match file.board_memory_mib {
        Some(mib) if !(mib.is_finite() && mib > 0.0) => Err(CommandError::said("board_memory_mib must be above zero")),
        written => {
            let written = written.map(|mib| (mib * f64::from(1 << 20)) as u64);
            Ok(args.board_memory.or(written).unwrap_or(u64::MAX))
        }
    }
}

/// For the test that reads every example: its views must be usable too.
#[cfg(test)]
pub(crate) fn check_example(file: &RigFile) {
    for entry in &file.views {
        view(entry).unwrap_or_else(|error| panic!("{error}"));
    }
    let args = RowArgs { views: None, size: None, samples: None };
    row(&args, None, file).unwrap_or_else(|error| panic!("{error}"));
    environment(&AirArgs::default(), &file.air).unwrap_or_else(|error| panic!("{error}"));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn samples_of_a_rig_file_are_a_number_or_exact() {
        let read = |entry: &str| {
            let file: RigFile = toml::from_str(&format!("[row]\nsamples = {entry}")).unwrap();
            samples(&file.row.samples.unwrap()).map_err(|error| error.to_string())
        };
        assert_eq!(read("64"), Ok(Samples::SixtyFour));
        assert_eq!(read("\"exact\""), Ok(Samples::Exact));
        assert_eq!(read("\"16\""), Ok(Samples::Sixteen));
        assert_eq!(read("2"), Err("samples = 2: possible are 1, 4, 8, 16, 64 or exact".into()));
        assert_eq!(read("\"all\""), Err("samples = \"all\": possible are 1, 4, 8, 16, 64 or exact".into()));
    }
}
