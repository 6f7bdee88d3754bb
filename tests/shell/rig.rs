//! Hosts with the daemons on them, and what can be done to the network between them.

use crate::network::{Entry, Ground};
use bench::disturbed::{Compared, Undisturbed};
use channel::simd::SimdLevel;
use link::Trust;
use manager::backplane::{Report, Stage};
use manager::host::camera::CameraFile;
use manager::scene::{Scene, builtin, import};
use manager::select::DetailMode;
use proto::chain::ClockMode;
use proto::frame::Environment;
use proto::pose::PosePacket;
use proto::view::{Mode, Samples, Tangents, View, ViewSetup};
use std::collections::BTreeMap;
use std::fmt::Write;
use std::net::{Ipv4Addr, SocketAddr};
use std::num::NonZeroUsize;
use std::path::PathBuf;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;
use tokio_util::sync::CancellationToken;
use turmoil::Sim;

/// Boards' hosts; a rig has the first so many.
const BOARDS: [&str; 4] = ["a", "b", "c", "d"];
const BACKPLANE_PORT: u16 = 7400;
const PERIOD: Duration = Duration::from_nanos(16_666_667);
/// What takes longer in virtual time won't happen.
const HANG: Duration = Duration::from_secs(60);
/// Different poses of the flight, and how many packets each stays: an undisturbed flight must show them all.
const POSES: usize = 40;
const STAYS: u32 = 3;
/// Segments that may be under way on a connection: more than are said while it is held up. turmoil loses the end of one that is full.
const ROOM: usize = 1024;
/// How long a frame takes to draw.
const DRAWING: Duration = Duration::from_millis(3);
/// How often a host's tasks are counted.
const CENSUS_PERIOD: Duration = Duration::from_millis(20);

/// Of each host, how many tasks it has and how many connections are open.
pub type Census = BTreeMap<&'static str, (usize, usize)>;

#[derive(Debug)]
struct Host {
    ground: Ground,
    tasks: Arc<AtomicUsize>,
}

/// See the crate's head.
pub struct Rig {
    sim: Sim<'static>,
    hosts: BTreeMap<&'static str, Host>,
    diary: Arc<Mutex<Vec<Entry>>>,
    report: Arc<Mutex<Option<Report>>>,
    folder: tempfile::TempDir,
    /// Lives of the compositor, each with a manifest of its own.
    lives: Arc<AtomicUsize>,
    log: String,
    logged: (usize, usize),
    restarts: u64,
}

impl std::fmt::Debug for Rig {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Rig").field("elapsed", &self.sim.elapsed()).field("hosts", &self.hosts).finish_non_exhaustive()
    }
}

fn locked<T>(mutex: &Mutex<T>) -> std::sync::MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Runs what a host does, and counts its tasks meanwhile.
async fn counted<T, E: std::error::Error + 'static>(
    tasks: Arc<AtomicUsize>,
    run: impl Future<Output = Result<T, E>>,
) -> turmoil::Result {
    let counting = async {
        loop {
            tasks.store(tokio::runtime::Handle::current().metrics().num_alive_tasks(), Ordering::Relaxed);
            tokio::time::sleep(CENSUS_PERIOD).await;
        }
    };
    tokio::select! {
        ended = run => ended.map(drop).map_err(Into::into),
        () = counting => Ok(()),
    }
}

fn any(port: u16) -> SocketAddr {
    SocketAddr::from((Ipv4Addr::UNSPECIFIED, port))
}

fn manager_config(scene: Arc<Scene>, camera: &CameraFile, boards: usize, trust: Trust) -> manager::backplane::Config {
    let row = View::row(2, 64, 48, Tangents::symmetric(50.0, 64, 48), Samples::One);
    let views = row.into_iter().map(|view| ViewSetup { mode: Mode::Interleave, ..ViewSetup::new(view) }).collect();
    manager::backplane::Config {
        select_ahead: manager::backplane::SelectAhead::default(),
        swap_lead: Duration::ZERO,
        stage: Stage {
            scene,
            views,
            row: None,
            environment: Environment::default(),
            detail: DetailMode::Finest,
            eye: camera.poses[0].pose().expect("the flight's poses are good"),
        },
        mode: ClockMode::RealTime { period: PERIOD },
        frames: None,
        wait_for_boards: boards,
        wait_for_compositor: true,
        scale_max: 1,
        board_memory: 1 << 30,
        trust,
        stands_by_for: None,
        listen: any(BACKPLANE_PORT),
        pose_listen: any(0),
        console_listen: None,
        console_token: None,
        otlp: None,
        progress: Arc::default(),
    }
}

/// The flight, over and over.
fn flight(camera: Arc<CameraFile>) -> impl Fn(u32) -> PosePacket {
    let each = (camera.poses.len() / POSES).max(1);
    move |sequence| {
        let pose = (sequence / STAYS) as usize % POSES * each % camera.poses.len();
        camera.packet(pose, sequence, false, None)
    }
}

impl Rig {
    /// Starts all hosts; nothing has happened yet.
    ///
    /// # Panics
    /// If the built-in scene can't be loaded.
    pub fn new(seed: u64, boards: usize) -> Self {
        Self::with_room(seed, boards, ROOM)
    }

    /// Likewise, with so much room for what is under way on a connection, segments: who doesn't read is noticed when it is full.
    ///
    /// # Panics
    /// If the built-in scene can't be loaded.
    pub fn with_room(seed: u64, boards: usize, room: usize) -> Self {
        let sim = turmoil::Builder::new()
            .rng_seed(seed)
            .simulation_duration(Duration::from_secs(3600))
            .min_message_latency(Duration::ZERO)
            .max_message_latency(Duration::from_millis(3))
            .tcp_capacity(room)
            .build();
        let mut rig = Self {
            sim,
            hosts: BTreeMap::new(),
            diary: Arc::default(),
            report: Arc::default(),
            folder: tempfile::tempdir().expect("a folder for manifests"),
            lives: Arc::default(),
            log: String::new(),
            logged: (0, 0),
            restarts: 0,
        };
        for (k, name) in ["manager", "wall"].into_iter().chain(BOARDS.into_iter().take(boards)).enumerate() {
            let ground = Ground::new(name, seed.wrapping_mul(31).wrapping_add(k as u64), rig.diary.clone());
            rig.hosts.insert(name, Host { ground, tasks: Arc::default() });
        }
        rig.start_manager(boards);
        rig.start_compositor();
        BOARDS.into_iter().take(boards).for_each(|name| rig.start_board(name));
        rig
    }

    fn trust(&self, host: &str) -> (Trust, Arc<AtomicUsize>) {
        let host = &self.hosts[host];
        (Trust::INSECURE.over(Arc::new(host.ground.clone())), host.tasks.clone())
    }

    fn start_manager(&mut self, boards: usize) {
        let built = builtin::build("runway").expect("it is built in");
        let scene = Arc::new(import::load_glb(&built.glb, built.name).expect("it is good"));
        let camera = Arc::new(built.camera);
        let (trust, tasks) = self.trust("manager");
        let report = self.report.clone();
        self.sim.host("manager", move || {
            let config = manager_config(scene.clone(), &camera, boards, trust.clone());
            let (host, report) = (flight(camera.clone()), report.clone());
            let look = move |now| *locked(&report) = Some(now);
            counted(tasks.clone(), manager::backplane::simulation::run(config, host, look))
        });
    }

    fn start_compositor(&mut self) {
        let (trust, tasks) = self.trust("wall");
        let (lives, folder) = (self.lives.clone(), self.folder.path().to_owned());
        self.sim.host("wall", move || {
            let life = lives.fetch_add(1, Ordering::Relaxed);
            let config = compositor::shell::Config {
                views: Vec::new(),
                window: None,
                backplanes: vec![format!("manager:{BACKPLANE_PORT}")],
                trust: trust.clone(),
                listen: any(7500),
                out: None,
                pattern: false,
                manifest: Some(folder.join(life.to_string())),
                once: false,
            };
            counted(tasks.clone(), compositor::shell::run(config, CancellationToken::new(), |_| ()))
        });
    }

    fn start_board(&mut self, name: &'static str) {
        let (trust, tasks) = self.trust(name);
        self.sim.host(name, move || {
            let config = channel::worker::Config {
                backplanes: vec![format!("manager:{BACKPLANE_PORT}")],
                trust: trust.clone(),
                listen: any(7600),
                advertise: None,
                threads: NonZeroUsize::MIN,
                simd: SimdLevel::default(),
                memory: 1 << 30,
                name: name.into(),
                once: false,
            };
            counted(tasks.clone(), channel::worker::simulation::run(config, CancellationToken::new(), || DRAWING))
        });
    }

    /// Adds a host that runs anything, once.
    pub fn client(&mut self, name: &'static str, client: impl Future<Output = turmoil::Result> + 'static) {
        self.sim.client(name, client);
    }

    /// The network between hosts.
    pub fn network(&mut self) -> &mut Sim<'static> {
        &mut self.sim
    }

    /// Writes into the log, with the time.
    pub fn note(&mut self, what: &str) {
        let ms = self.sim.elapsed().as_millis();
        writeln!(self.log, "{ms:>7} {what}").expect("a string takes everything");
    }

    /// Lets virtual time pass.
    pub fn run(&mut self, time: Duration) {
        let until = self.sim.elapsed() + time;
        while self.sim.elapsed() < until {
            self.step();
        }
    }

    fn step(&mut self) {
        self.sim.step().unwrap_or_else(|error| panic!("a daemon ended: {error}\n{}", self.log));
        let diary = self.diary.clone();
        let entries: Vec<Entry> = locked(&diary)[self.logged.0..].to_vec();
        self.logged.0 += entries.len();
        for Entry { at, from, to, came } in entries {
            let ms = at.as_millis();
            self.note(&format!("{from} dialled {to} at {ms}: {came:?}"));
        }
        let events = locked(&self.report).as_ref().map_or_else(Vec::new, |report| report.events.clone());
        if events.len() < self.logged.1 {
            // Another life of the manager.
            self.logged.1 = 0;
        }
        for event in &events[self.logged.1..] {
            self.note(&format!("manager {:.3} {} {}", event.time_s, event.event, event.detail));
        }
        self.logged.1 = events.len();
    }

    /// Until something holds of the manager's statistics.
    ///
    /// # Panics
    /// If it doesn't within a minute of virtual time.
    pub fn until(&mut self, what: &str, holds: impl Fn(&Report) -> bool) -> Report {
        let since = self.sim.elapsed();
        loop {
            if let Some(report) = locked(&self.report).as_ref().filter(|report| holds(report)) {
                return report.clone();
            }
            assert!(self.sim.elapsed() < since + HANG, "{what} didn't happen\n{}", self.log);
            self.step();
        }
    }

    /// Until all boards draw.
    pub fn until_flying(&mut self, boards: usize) -> Report {
        let is_so =
            |report: &Report| report.boards == boards && of(report, "draws", "") >= boards && report.frames > 60;
        self.until("flight", is_so)
    }

    /// Ends a host's daemon, as `kill -9` does.
    pub fn crash(&mut self, host: &'static str) {
        self.note(&format!("{host} crashes"));
        if host == "manager" {
            *locked(&self.report) = None;
        }
        self.sim.crash(host);
    }

    /// Starts it again.
    pub fn bounce(&mut self, host: &'static str) {
        self.note(&format!("{host} starts again"));
        self.restarts += u64::from(host == "manager");
        self.sim.bounce(host);
    }

    /// Connections that were tried since then.
    pub fn dialled(&self, from: &str, since: Duration) -> Vec<Entry> {
        locked(&self.diary).iter().filter(|entry| entry.from == from && entry.at >= since).cloned().collect()
    }

    /// Tasks and connections of all hosts.
    pub fn census(&self) -> Census {
        let count = |host: &Host| (host.tasks.load(Ordering::Relaxed), host.ground.open());
        self.hosts.iter().map(|(name, host)| (*name, count(host))).collect()
    }

    /// What has happened, with times.
    pub fn log(&self) -> &str {
        &self.log
    }

    /// How often the manager was started again. Without a stand-by it then counts frames anew.
    pub fn restarts(&self) -> u64 {
        self.restarts
    }

    /// The manifests of the compositor's lives.
    pub fn manifests(&self) -> Vec<String> {
        let lives = self.lives.load(Ordering::Relaxed);
        let path = |life: usize| -> PathBuf { self.folder.path().join(life.to_string()) };
        (0..lives).map(|life| std::fs::read_to_string(path(life)).unwrap_or_default()).collect()
    }

    /// What was shown, compared with a flight that nothing was done to. What was on the canvas when a compositor came says not what it depends on.
    ///
    /// # Panics
    /// If a manifest is none.
    pub fn compare(&self, undisturbed: &Undisturbed) -> Compared {
        let mut all = Compared::default();
        for manifest in self.manifests() {
            let told: String = manifest.split_inclusive('\n').filter(|line| line.contains("\"eye\"")).collect();
            let Compared { frames, right, repeated, wrong, unknown, backwards } =
                undisturbed.compare(told.as_bytes()).expect("it is a manifest");
            all.frames += frames;
            all.right += right;
            all.repeated += repeated;
            all.wrong += wrong;
            all.unknown += unknown;
            all.backwards += backwards;
        }
        all
    }
}

/// Events of a kind whose detail has this in it.
pub fn of(report: &Report, event: &str, about: &str) -> usize {
    report.events.iter().filter(|line| line.event == event && line.detail.contains(about)).count()
}

/// What the same path shows when one board draws it and nothing is done.
///
/// # Panics
/// If it isn't flown.
pub fn undisturbed() -> Undisturbed {
    let mut rig = Rig::new(1, 1);
    rig.until_flying(1);
    rig.run(PERIOD * (POSES as u32) * STAYS + Duration::from_secs(1));
    let whole = |line: &&str| line.contains("\"eye\"") && !line.contains("\"complete\":false");
    let manifest: String = rig.manifests().concat().split_inclusive('\n').filter(whole).collect();
    let undisturbed = Undisturbed::read(manifest.as_bytes()).expect("it is a manifest");
    assert_eq!(undisturbed.len(), POSES, "every pose is shown");
    undisturbed
}
