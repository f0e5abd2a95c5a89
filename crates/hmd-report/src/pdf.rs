//! Prints an HTML page to PDF with the Chromium of this computer.

use std::fmt::Write;
use std::fs::File;
use std::io::{self, Read};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use hmd_storage::output_file::OutputFile;

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
    /// The browser ended without the file, or did not end.
    #[error("{browser} printed no page: {said}")]
    Browser {
        /// The browser.
        browser: String,
        /// The last line that it wrote.
        said: String,
    },
}

/// Longest time that the browser may take.
const TIME_MAX: Duration = Duration::from_secs(120);

/// How a PDF file begins.
const PDF: &[u8] = b"%PDF";

/// Time between two looks at the browser.
const LOOK_EVERY: Duration = Duration::from_millis(20);

/// Prints the page `html` into the file `pdf`. The browser runs without a window, a network request and a profile of its own. An older
/// file stays where it fails.
///
/// # Errors
/// [`PdfError`].
pub fn print(html: &Path, pdf: &Path) -> Result<(), PdfError> {
    let browser = BROWSERS
        .iter()
        .find_map(|name| in_path(name))
        .ok_or(PdfError::NoBrowser)?;
    print_with(&browser, html, pdf, TIME_MAX)
}

fn print_with(browser: &Path, html: &Path, pdf: &Path, time_max: Duration) -> Result<(), PdfError> {
    let io = |path: &Path| {
        let path = path.display().to_string();
        move |source| PdfError::Io { path, source }
    };
    let failed = |said: &str| PdfError::Browser {
        browser: browser.display().to_string(),
        said: said.to_owned(),
    };
    let page = html.canonicalize().map_err(io(html))?;
    let folder = tempfile::tempdir().map_err(io(Path::new("temporary folder")))?;
    let messages = folder.path().join("messages");
    // Beside its place: a confined browser has another temporary folder.
    let output = OutputFile::create(pdf).map_err(io(pdf))?;
    let mut command = Command::new(browser);
    command
        .args([
            "--headless",
            "--disable-gpu",
            "--no-pdf-header-footer",
            "--disable-dev-shm-usage",
        ])
        .arg(format!("--user-data-dir={}", folder.path().join("profile").display()))
        .arg(format!("--print-to-pdf={}", output.written_path().display()))
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(File::create(&messages).map_err(io(&messages))?);
    if rustix::process::geteuid().is_root() {
        // The browser refuses to start its sandbox as root; the page has no script and fetches nothing.
        command.arg("--no-sandbox");
    }
    let mut browsing = command.arg(file_url(&page)).spawn().map_err(io(browser))?;
    let since = Instant::now();
    let ended = loop {
        if let Some(ended) = browsing.try_wait().map_err(io(browser))? {
            break ended;
        }
        if since.elapsed() > time_max {
            // It may have ended meanwhile.
            let _ = browsing.kill();
            let _ = browsing.wait();
            return Err(failed(&format!("it took longer than {} s", time_max.as_secs())));
        }
        std::thread::sleep(LOOK_EVERY);
    };
    let mut begin = Vec::new();
    let printed = File::open(output.written_path()).map_err(io(pdf))?;
    printed
        .take(PDF.len() as u64)
        .read_to_end(&mut begin)
        .map_err(io(pdf))?;
    if ended.success() && begin == PDF {
        return output.put_in_place().map_err(io(pdf));
    }
    let said = std::fs::read(&messages).unwrap_or_default();
    Err(failed(
        String::from_utf8_lossy(&said).lines().last().unwrap_or_default(),
    ))
}

/// The address of a file: what is not plain in its path is escaped.
fn file_url(path: &Path) -> String {
    let mut url = "file://".to_owned();
    for byte in path.as_os_str().as_encoded_bytes() {
        match byte {
            b'/' | b'-' | b'_' | b'.' | b'~' => url.push(char::from(*byte)),
            byte if byte.is_ascii_alphanumeric() => url.push(char::from(*byte)),
            byte => {
                let _ = write!(url, "%{byte:02X}");
            }
        }
    }
    url
}

/// The file of a program in `PATH`.
fn in_path(name: &str) -> Option<PathBuf> {
    let folders = std::env::var_os("PATH")?;
    std::env::split_paths(&folders)
        .map(|folder| folder.join(name))
        .find(|path| path.is_file())
}

#[cfg(test)]
mod tests {
    use std::os::unix::fs::PermissionsExt;

    use super::*;

    #[test]
    fn only_what_the_browser_prints_now_takes_the_place_of_an_older_file() {
        let folder = tempfile::tempdir().unwrap();
        let [page, pdf, browser] = ["rep #1 50%.html", "out.pdf", "browser"].map(|name| folder.path().join(name));
        std::fs::write(&page, "<p>").unwrap();
        std::fs::write(&pdf, "%PDF of before").unwrap();
        let print = |script: &str| {
            std::fs::write(&browser, format!("#!/bin/sh\n{script}\n")).unwrap();
            std::fs::set_permissions(&browser, std::fs::Permissions::from_mode(0o755)).unwrap();
            let printed = print_with(&browser, &page, &pdf, Duration::from_secs(1));
            (
                printed.map_err(|error| error.to_string()),
                std::fs::read_to_string(&pdf).unwrap(),
            )
        };
        let (printed, file) = print("echo no page >&2");
        assert!(printed.is_err_and(|error| error.ends_with("printed no page: no page")));
        assert_eq!(file, "%PDF of before");
        let (printed, file) = print("exec sleep 60");
        assert!(printed.is_err_and(|error| error.ends_with("it took longer than 1 s")));
        assert_eq!(file, "%PDF of before");
        let (printed, file) = print(
            "for a in \"$@\"; do case $a in --print-to-pdf=*) out=${a#*=};; file://*) url=$a;; esac; done\necho \"%PDF of $url\" > \"$out\"",
        );
        assert_eq!(printed, Ok(()));
        assert!(
            file.starts_with("%PDF of file:///") && file.ends_with("/rep%20%231%2050%25.html\n"),
            "{file}"
        );
    }
}
