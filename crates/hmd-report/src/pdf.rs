//! Prints an HTML page to PDF with the Chromium of this computer.

use std::io;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// Names of the browser in `PATH`, in the order in which they are tried.
const BROWSERS: [&str; 4] = ["chromium", "chromium-browser", "google-chrome", "chrome"];

/// Why there is no PDF.
#[derive(Debug, thiserror::Error)]
pub enum PdfError {
    /// No browser in `PATH`.
    #[error("expected one of {} in PATH, found none", BROWSERS.join(", "))]
    NoBrowser,
    /// The browser cannot be started, or a path cannot be resolved.
    #[error("{path}: {source}")]
    Io {
        /// The browser or the page.
        path: String,
        /// Why.
        source: io::Error,
    },
    /// The browser ended without the file.
    #[error("{browser} printed no page: {said}")]
    Browser {
        /// The browser.
        browser: String,
        /// The last line that it wrote.
        said: String,
    },
}

/// Prints the page `html` into the file `pdf`. The browser runs without a window, a network request and a profile of its own.
///
/// # Errors
/// [`PdfError`].
pub fn print(html: &Path, pdf: &Path) -> Result<(), PdfError> {
    let io = |path: &Path| {
        let path = path.display().to_string();
        move |source| PdfError::Io { path, source }
    };
    let browser = BROWSERS
        .iter()
        .find_map(|name| in_path(name))
        .ok_or(PdfError::NoBrowser)?;
    let page = html.canonicalize().map_err(io(html))?;
    let profile = tempfile::tempdir().map_err(io(Path::new("temporary folder")))?;
    let mut command = Command::new(&browser);
    command
        .args([
            "--headless",
            "--disable-gpu",
            "--no-pdf-header-footer",
            "--disable-dev-shm-usage",
        ])
        .arg(format!("--user-data-dir={}", profile.path().display()))
        .arg(format!("--print-to-pdf={}", pdf.display()))
        .stdin(Stdio::null());
    if rustix::process::geteuid().is_root() {
        // The browser refuses to start its sandbox as root; the page has no script and fetches nothing.
        command.arg("--no-sandbox");
    }
    let ended = command
        .arg(format!("file://{}", page.display()))
        .output()
        .map_err(io(&browser))?;
    if ended.status.success() && pdf.metadata().is_ok_and(|about| about.len() > 0) {
        return Ok(());
    }
    let said = String::from_utf8_lossy(&ended.stderr);
    Err(PdfError::Browser {
        browser: browser.display().to_string(),
        said: said.lines().last().unwrap_or_default().to_owned(),
    })
}

/// The file of a program in `PATH`.
fn in_path(name: &str) -> Option<PathBuf> {
    let folders = std::env::var_os("PATH")?;
    std::env::split_paths(&folders)
        .map(|folder| folder.join(name))
        .find(|path| path.is_file())
}
