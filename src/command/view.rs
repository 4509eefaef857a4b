//! `omniwalk view`.

use std::fs::File;
use std::io::Read;
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr, UdpSocket};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::sync_channel;
use std::thread::JoinHandle;
use std::time::Duration;

use miette::{IntoDiagnostic, WrapErr, miette};
use omniwalk_controller::Policy;
use omniwalk_env::robot::Robot;
use tokio::net::TcpListener;
use tokio::runtime::Builder;
use tokio::sync::{broadcast, watch};

use super::load;
use crate::deployed::Deployed;
use crate::export;
use crate::run::{RunFolder, files_of};
use crate::settings::{DEFAULT, Settings};
use crate::terminal::{interrupt, say};
use crate::view::clips::Clips;
use crate::view::describe;
use crate::view::drive::Drive;
use crate::view::listen::serve as serve_page;
use crate::view::live::Live;
use crate::view::orders::Limits;
use crate::view::pilot::Pilot;
use crate::view::server::{Ride, Served, routes};

/// Shows the robot in the browser: plays logs, and lets you drive a policy live.
///
/// Serves a page on this machine and prints its address. Of a run it plays the rollouts and drives the newest policy, of a
/// policy file it drives it, a log it plays. Foxglove can connect to the printed second address meanwhile. Ctrl-C ends it.
#[derive(clap::Args, Debug)]
pub struct Args {
    /// Run folder, policy file, or log (MCAP).
    #[arg(value_name = "RUN_OR_POLICY_OR_LOG")]
    path: PathBuf,
    /// Robot folder or URDF [default: the run's; else that of the defaults].
    #[arg(long, value_name = "FILE")]
    robot: Option<PathBuf>,
    /// Physics engine in which it is driven [default: rapier].
    #[arg(long, value_parser = ["rapier", "lanes"])]
    engine: Option<String>,
    /// Where to listen; addresses other than this machine's own let others look and, with the token, drive.
    #[arg(long, value_name = "ADDRESS:PORT", value_parser = address, default_value_t = SocketAddr::from((Ipv4Addr::LOCALHOST, 8040)))]
    listen: SocketAddr,
    /// Port for Foxglove, at the same address [default: 8765, or any if that is taken].
    #[arg(long, value_name = "PORT")]
    foxglove_port: Option<u16>,
    /// Where recordings go [default: RUN/recordings, or NAME.recordings beside NAME.omni].
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Seed of the sensors' noise.
    #[arg(long, value_name = "N", default_value_t = 1000)]
    seed: u64,
    /// Changes a single value of the configuration.
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
}

/// Orders that wait for the next control step.
const ORDERS: usize = 64;
/// Rows that wait for a slow client before the oldest are dropped: a second.
const FRAMES: usize = 40;
/// How often it is looked whether to stop.
const LOOK: Duration = Duration::from_millis(50);

/// What is shown.
struct Show {
    robot: Arc<Robot>,
    logs: Vec<PathBuf>,
    drive: Option<Drive>,
    /// Where recordings go.
    folder: PathBuf,
}

/// Runs the command.
///
/// # Errors
/// When there is nothing to show, or the addresses are taken.
pub fn run(args: &Args) -> miette::Result<()> {
    let show = Show::open(args)?;
    let stop = interrupt().into_diagnostic()?;
    let runtime = Builder::new_current_thread().enable_all().build().into_diagnostic()?;
    runtime.block_on(serve(args, show, stop))
}

async fn serve(args: &Args, show: Show, stop: Arc<AtomicBool>) -> miette::Result<()> {
    let listener = TcpListener::bind(args.listen)
        .await
        .into_diagnostic()
        .wrap_err_with(|| format!("cannot listen at {}; --listen ADDRESS:PORT gives another", args.listen))?;
    let address = listener.local_addr().into_diagnostic()?;
    let clips = Arc::new(Clips::new(&show.robot, show.logs));
    let token = token()?;
    let robot = describe::robot(&show.robot, show.drive.is_some()).to_string();
    let (ride, pilot) = match show.drive {
        None => (None, None),
        Some(drive) => {
            let (live, port) = listen(&drive, args, &show.robot.name).await?;
            let (ride, pilot) = start(drive, live, &clips, show.folder, &stop)?;
            (Some(ride), Some((pilot, port)))
        }
    };
    say(format_args!("open http://{}/?token={token}", reachable(address)))?;
    if let Some(ip) = address.ip().is_unspecified().then(outside).flatten() {
        let elsewhere = SocketAddr::new(ip, address.port());
        say(format_args!("from another machine: http://{elsewhere}/?token={token}"))?;
    }
    if let Some((_, port)) = &pilot {
        say(format_args!(
            "Foxglove: ws://{}",
            reachable(SocketAddr::new(address.ip(), *port))
        ))?;
    }
    let served = Served {
        token,
        robot,
        clips,
        ride,
    };
    tokio::select! {
        ended = serve_page(listener, routes(served)) => ended.into_diagnostic()?,
        () = until(&stop, pilot.as_ref().map(|(pilot, _)| pilot)) => {}
    }
    stop.store(true, Ordering::Relaxed);
    match pilot.map(|(pilot, _)| pilot.join()) {
        Some(Err(_)) => Err(miette!("the simulation has ended by itself")),
        _ => Ok(()),
    }
}

/// Foxglove's server.
async fn listen(drive: &Drive, args: &Args, name: &str) -> miette::Result<(Live, u16)> {
    let samples: Vec<_> = drive
        .messages(drive.period())
        .into_iter()
        .map(|(_, message)| message)
        .collect();
    Live::start(
        args.listen.ip(),
        args.foxglove_port,
        name,
        &samples,
        &drive.description(),
    )
    .await
}

/// The robot's thread, and the way to it.
fn start(
    drive: Drive,
    live: Live,
    clips: &Arc<Clips>,
    folder: PathBuf,
    stop: &Arc<AtomicBool>,
) -> miette::Result<(Ride, JoinHandle<()>)> {
    let limits: Limits = *drive.limits();
    let (orders, incoming) = sync_channel(ORDERS);
    let (frames, _) = broadcast::channel(FRAMES);
    let (reports, newest) = watch::channel(String::from("{\"type\":\"report\"}"));
    let pilot = Pilot {
        drive,
        orders: incoming,
        frames: frames.clone(),
        reports,
        live: Some(live),
        clips: clips.clone(),
        folder,
        stop: stop.clone(),
    };
    let thread = std::thread::Builder::new()
        .name("pilot".into())
        .spawn(move || pilot.fly());
    let ride = Ride {
        orders,
        frames,
        reports: newest,
        limits,
    };
    Ok((ride, thread.into_diagnostic()?))
}

/// Returns once the program is told to stop, or the robot's thread has ended.
async fn until(stop: &AtomicBool, pilot: Option<&JoinHandle<()>>) {
    while !stop.load(Ordering::Relaxed) && !pilot.is_some_and(JoinHandle::is_finished) {
        tokio::time::sleep(LOOK).await;
    }
}

/// What only those know who are told: 128 random bits.
fn token() -> miette::Result<String> {
    let mut bytes = [0; 16];
    getrandom::fill(&mut bytes).map_err(|error| miette!("the system gives no random numbers: {error}"))?;
    Ok(bytes.iter().map(|byte| format!("{byte:02x}")).collect())
}

/// Where this machine reaches `address`.
fn reachable(address: SocketAddr) -> SocketAddr {
    let ip = match address.ip() {
        IpAddr::V4(ip) if ip.is_unspecified() => Ipv4Addr::LOCALHOST.into(),
        IpAddr::V6(ip) if ip.is_unspecified() => Ipv6Addr::LOCALHOST.into(),
        ip => ip,
    };
    SocketAddr::new(ip, address.port())
}

/// The address that others in the network reach this machine by, if it is in one: that of the way out. Nothing is sent.
fn outside() -> Option<IpAddr> {
    let socket = UdpSocket::bind((Ipv4Addr::UNSPECIFIED, 0)).ok()?;
    // An address kept for documentation (RFC 5737).
    socket.connect((Ipv4Addr::new(192, 0, 2, 1), 9)).ok()?;
    Some(socket.local_addr().ok()?.ip())
}

impl Show {
    fn open(args: &Args) -> miette::Result<Self> {
        let path = &args.path;
        if path.is_dir() {
            return Self::folder(args);
        }
        if is_log(path)? || path.extension().is_some_and(|extension| extension == "mcap") {
            let beside = path.parent().and_then(Path::parent).map(|run| run.join("robot"));
            let robot = robot(args, beside.as_deref())?;
            let clips = Clips::new(&robot, vec![path.clone()]);
            // Whatever is wrong with it is said here, not in the browser.
            clips.rows(path)?;
            return Ok(Self {
                robot,
                logs: vec![path.clone()],
                drive: None,
                folder: PathBuf::new(),
            });
        }
        let folder = args.out.clone().unwrap_or_else(|| path.with_extension("recordings"));
        let mut logs = files_of(&path.with_extension("eval").join("rollouts"), "mcap").unwrap_or_default();
        logs.extend(files_of(&folder, "mcap").unwrap_or_default());
        let deployed = deploy(args, load::policy(path)?, args.robot.as_deref())?;
        Ok(Self {
            robot: deployed.robot.clone(),
            logs,
            drive: Some(Drive::new(&deployed, args.seed)?),
            folder,
        })
    }

    /// A run, or a folder with a policy file.
    fn folder(args: &Args) -> miette::Result<Self> {
        let path = &args.path;
        let folder = args.out.clone().unwrap_or_else(|| path.join("recordings"));
        let exported = path.join("policy.omni");
        let own = Some(path.join("robot")).filter(|robot| robot.is_dir());
        let policy = if exported.is_file() {
            Some(load::policy(&exported)?)
        } else {
            let run = RunFolder::open(path)?;
            let begun = !run.checkpoints().list().is_empty();
            begun.then(|| export::policy(path, None)).transpose()?
        };
        let mut logs = files_of(&path.join("rollouts"), "mcap").unwrap_or_default();
        logs.extend(files_of(&folder, "mcap").unwrap_or_default());
        if policy.is_none() && logs.is_empty() {
            return Err(miette!(
                help = "train for a while, or evaluate the run: `omniwalk eval` writes rollouts",
                "{} holds neither a checkpoint nor a rollout yet",
                path.display()
            ));
        }
        let chosen = args.robot.as_deref().or(own.as_deref());
        let deployed = policy.map(|policy| deploy(args, policy, chosen)).transpose()?;
        Ok(Self {
            robot: match &deployed {
                Some(deployed) => deployed.robot.clone(),
                None => robot(args, own.as_deref())?,
            },
            logs,
            drive: deployed.map(|deployed| Drive::new(&deployed, args.seed)).transpose()?,
            folder,
        })
    }
}

/// `policy` under nominal conditions, which the page changes, in the engine of the arguments.
fn deploy(args: &Args, policy: Policy, robot: Option<&Path>) -> miette::Result<Deployed> {
    let nominal = [
        "friction.enabled=false",
        "randomise.mass=0.0",
        "randomise.centre_of_mass=0.0",
    ];
    let mut changes: Vec<String> = nominal.map(str::to_owned).to_vec();
    changes.extend(load::played(args.engine.as_deref(), &args.set));
    Deployed::new(policy, &args.path, robot, &changes)
}

/// The robot of the arguments, or the one at `own`, or that of the defaults.
fn robot(args: &Args, own: Option<&Path>) -> miette::Result<Arc<Robot>> {
    match args.robot.as_deref().or(own.filter(|robot| robot.is_dir())) {
        Some(robot) => load::robot(robot),
        None => {
            let (settings, _): (Settings, String) = crate::config::Layers::new(DEFAULT)?.build()?;
            load::robot(&settings.robot.path).wrap_err_with(|| {
                let path = args.path.display();
                format!("{path} does not say which robot it is of: give `--robot DIR`, a robot's folder")
            })
        }
    }
}

fn address(text: &str) -> Result<SocketAddr, String> {
    let example = |_| "give an address of this machine and a port, such as 127.0.0.1:8040".to_owned();
    text.parse().map_err(example)
}

/// Whether the file at `path` is an MCAP file.
fn is_log(path: &Path) -> miette::Result<bool> {
    let mut magic = [0; 5];
    let read = crate::files::open(path).and_then(|mut file: File| file.read(&mut magic));
    read.into_diagnostic()
        .wrap_err_with(|| format!("cannot read {}", path.display()))?;
    Ok(magic == *b"\x89MCAP")
}
