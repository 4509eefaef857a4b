//! Where Python and MuJoCo come from: an environment that this program makes for itself, one that the user names, or an
//! interpreter that the user names. Nothing is ever put into an environment that this program did not make.

use crate::terminal::tell;
use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::process::Command;

use miette::{IntoDiagnostic, WrapErr, miette};
use sha2::{Digest, Sha256};

/// The packages, pinned.
pub const LOCK: &str = include_str!("../../python/crosscheck.txt");

/// The Python side: MuJoCo's model and the second reading of robot and policy files.
const SOURCES: [(&str, &str); 11] = [
    (
        "__init__.py",
        include_str!("../../python/omniwalk_reference/__init__.py"),
    ),
    (
        "dynamics.py",
        include_str!("../../python/omniwalk_reference/dynamics.py"),
    ),
    ("mjcf.py", include_str!("../../python/omniwalk_reference/mjcf.py")),
    (
        "policy_file.py",
        include_str!("../../python/omniwalk_reference/policy_file.py"),
    ),
    ("pose.py", include_str!("../../python/omniwalk_reference/pose.py")),
    ("robot.py", include_str!("../../python/omniwalk_reference/robot.py")),
    ("server.py", include_str!("../../python/omniwalk_reference/server.py")),
    ("tree.py", include_str!("../../python/omniwalk_reference/tree.py")),
    ("urdf.py", include_str!("../../python/omniwalk_reference/urdf.py")),
    ("walker.py", include_str!("../../python/omniwalk_reference/walker.py")),
    ("worlds.py", include_str!("../../python/omniwalk_reference/worlds.py")),
];

/// Ends a Python that is too old, which may not know the options of newer ones.
const OLDEST: &str = "import sys\nif sys.version_info < (3, 11): sys.exit('Python 3.11 or newer is needed, this is ' + sys.version.split()[0])\n";

/// What begins an environment of this program, and what completes it.
const BEGUN: &str = "omniwalk-begun";
const COMPLETE: &str = "omniwalk-complete";

/// A Python interpreter that has MuJoCo, with this program's Python sources beside it for as long as it lives.
#[derive(Debug)]
pub struct Python {
    program: PathBuf,
    sources: PathBuf,
    /// MuJoCo's version.
    pub mujoco: String,
}

impl Python {
    /// The interpreter `program`, or that of the environment in `environment`, or of the one in the user's cache, which are
    /// made if they are not there.
    ///
    /// # Errors
    /// When there is no Python, no MuJoCo, or the environment cannot be made: what to do then.
    pub fn open(program: Option<&Path>, environment: Option<&Path>) -> miette::Result<Self> {
        let (program, mujoco) = match program {
            Some(program) => (program.to_owned(), version(program)?),
            None => own(&environment.map_or_else(default_folder, |folder| Ok(folder.to_owned()))?)?,
        };
        Ok(Self {
            sources: write_sources()?,
            program,
            mujoco,
        })
    }

    /// The interpreter.
    pub fn program(&self) -> &Path {
        &self.program
    }

    /// Makes `command`, an interpreter, the server of this program's requests.
    pub fn server<'a>(&self, command: &'a mut Command) -> &'a mut Command {
        // MuJoCo writes its warnings to a file in the working folder, which goes with the sources.
        let start = "import os, sys; sys.path.insert(0, sys.argv[1]); os.chdir(sys.argv[1]); from omniwalk_reference import server; server.main()";
        // A thread for each process: linear algebra in several would only get in the way.
        command.env("OMP_NUM_THREADS", "1").env("OPENBLAS_NUM_THREADS", "1");
        command.args(["-B", "-P", "-c", start]).arg(&self.sources)
    }
}

impl Drop for Python {
    fn drop(&mut self) {
        // A folder that stays is a nuisance, not a fault.
        let _ = fs::remove_dir_all(&self.sources);
    }
}

/// The Python sources in a folder of their own.
fn write_sources() -> miette::Result<PathBuf> {
    let nanos = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH);
    let unique = nanos.map_or(0, |time| time.as_nanos());
    let folder = std::env::temp_dir().join(format!("omniwalk-crosscheck-{}-{unique}", std::process::id()));
    let package = folder.join("omniwalk_reference");
    let cannot = || format!("cannot write to {}", folder.display());
    fs::create_dir(&folder).into_diagnostic().wrap_err_with(cannot)?;
    fs::create_dir(&package).into_diagnostic().wrap_err_with(cannot)?;
    for (name, text) in SOURCES {
        fs::write(package.join(name), text)
            .into_diagnostic()
            .wrap_err_with(cannot)?;
    }
    Ok(folder)
}

/// MuJoCo's version in the interpreter at `program`.
fn version(program: &Path) -> miette::Result<String> {
    let script = format!(
        "{OLDEST}sys.path = [path for path in sys.path if path]\nimport numpy, mujoco\nif int(mujoco.__version__.split('.')[0]) < 3: sys.exit('MuJoCo 3 or newer is needed, this is ' + mujoco.__version__)\nprint(mujoco.__version__)"
    );
    let output = Command::new(program).args(["-B", "-c", &script]).output().map_err(|error| {
        miette!(
            help = "give the interpreter of an environment with MuJoCo, such as --python venv/bin/python, or leave --python out: omniwalk then makes an environment of its own",
            "cannot start Python at {}: {error}",
            program.display()
        )
    })?;
    if output.status.success() {
        return Ok(String::from_utf8_lossy(&output.stdout).trim().to_owned());
    }
    let said = String::from_utf8_lossy(&output.stderr);
    Err(miette!(
        help = format!(
            "get them by: {} -m pip install {}\nor leave --python out: omniwalk then makes an environment of its own",
            program.display(),
            pins().join(" ")
        ),
        "{} has not what the cross-check needs: {}",
        program.display(),
        said.trim().lines().last().unwrap_or("it says nothing")
    ))
}

fn pins() -> Vec<&'static str> {
    LOCK.lines().filter(|line| line.contains("==")).collect()
}

/// The folder of this program's environment: in the user's cache, by what is in it.
fn default_folder() -> miette::Result<PathBuf> {
    let home = |rest: &str| std::env::home_dir().map(|home| home.join(rest));
    let named = |name: &str| {
        std::env::var_os(name)
            .map(PathBuf::from)
            .filter(|path| path.is_absolute())
    };
    let cache = if cfg!(windows) {
        named("LOCALAPPDATA")
    } else if cfg!(target_os = "macos") {
        home("Library/Caches")
    } else {
        named("XDG_CACHE_HOME").or_else(|| home(".cache"))
    };
    let cache = cache.ok_or_else(|| {
        miette!(
            help = "say where the environment may be made by --venv DIR",
            "there is no home folder to keep MuJoCo's Python environment in"
        )
    })?;
    let digest = Sha256::digest(LOCK);
    Ok(cache.join("omniwalk").join(format!(
        "mujoco-{:02x}{:02x}{:02x}{:02x}",
        digest[0], digest[1], digest[2], digest[3]
    )))
}

/// The interpreter of the environment in `folder` and its MuJoCo's version; one that is damaged is made anew.
fn own(folder: &Path) -> miette::Result<(PathBuf, String)> {
    let program = environment_of(folder)?;
    if let Ok(found) = version(&program) {
        return Ok((program, found));
    }
    tell(format_args!(
        "the Python environment in {} is damaged",
        folder.display()
    ));
    fs::remove_file(folder.join(COMPLETE))
        .into_diagnostic()
        .wrap_err_with(|| format!("cannot use {}", folder.display()))?;
    let program = environment_of(folder)?;
    let found = version(&program)?;
    Ok((program, found))
}

/// The interpreter of the environment in `folder`, which is made if it is not whole. Another process that makes it is waited
/// for.
fn environment_of(folder: &Path) -> miette::Result<PathBuf> {
    let interpreter = folder.join(if cfg!(windows) {
        "venv/Scripts/python.exe"
    } else {
        "venv/bin/python"
    });
    let whole = || fs::read_to_string(folder.join(COMPLETE)).is_ok_and(|lock| lock == LOCK);
    if whole() {
        return Ok(interpreter);
    }
    let cannot = || format!("cannot use {}", folder.display());
    if fs::read_dir(folder).is_ok_and(|mut entries| entries.next().is_some()) && !folder.join(BEGUN).exists() {
        return Err(miette!(
            help = "name a folder that does not exist yet, or give an environment of your own by --python FOLDER/bin/python",
            "{} is not empty and was not made by omniwalk: nothing is installed there",
            folder.display()
        ));
    }
    fs::create_dir_all(folder).into_diagnostic().wrap_err_with(cannot)?;
    let begun = File::create(folder.join(BEGUN))
        .into_diagnostic()
        .wrap_err_with(cannot)?;
    begun.lock().into_diagnostic().wrap_err_with(cannot)?;
    if !whole() {
        make(folder, &interpreter)?;
    }
    Ok(interpreter)
}

/// Makes the environment in `folder`.
fn make(folder: &Path, interpreter: &Path) -> miette::Result<()> {
    tell(format_args!(
        "making a Python environment with MuJoCo in {}",
        folder.display()
    ));
    let lock = folder.join("crosscheck.txt");
    let cannot = || format!("cannot write {}", lock.display());
    fs::write(&lock, LOCK).into_diagnostic().wrap_err_with(cannot)?;
    let python = if cfg!(windows) { "python" } else { "python3" };
    let what = "Python 3.11 or newer with its module venv (on Debian and Ubuntu: apt install python3-venv)";
    step(Command::new(python).args(["-c", OLDEST]), what)?;
    step(
        Command::new(python)
            .args(["-m", "venv", "--clear"])
            .arg(folder.join("venv")),
        what,
    )?;
    let mut install = Command::new(interpreter);
    install
        .args([
            "-m",
            "pip",
            "install",
            "--quiet",
            "--disable-pip-version-check",
            "--requirement",
        ])
        .arg(&lock);
    step(&mut install, "access to a package index")?;
    fs::write(folder.join(COMPLETE), LOCK)
        .into_diagnostic()
        .wrap_err_with(cannot)
}

/// Runs a command that needs `what`.
fn step(command: &mut Command, what: &str) -> miette::Result<()> {
    let help = || {
        format!(
            "this needs {what}. By hand: python3 -m venv DIR, DIR/bin/pip install {}, then give --python DIR/bin/python",
            pins().join(" ")
        )
    };
    let output = command
        .output()
        .map_err(|error| miette!(help = help(), "cannot run {:?}: {error}", command.get_program()))?;
    if output.status.success() {
        return Ok(());
    }
    let said = [&output.stdout, &output.stderr]
        .map(|text| String::from_utf8_lossy(text).trim().to_owned())
        .join("\n");
    Err(miette!(
        help = help(),
        "MuJoCo's Python environment cannot be made: {}",
        said.trim()
    ))
}
