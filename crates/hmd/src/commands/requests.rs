//! What an operator asks of a running daemon, until it is carried out. No signals, threads or files: `model` explores it state by state.

/// Request of an operator.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) enum Request {
    /// SIGINT or SIGTERM.
    Stop,
    /// SIGHUP: go on with the configuration as it is now.
    Reload,
}

/// Requests that wait. Many reloads are one, which takes the configuration as it is when it begins; one that is asked for after
/// that waits for its own turn. A stop comes first, and stays.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub(crate) struct Requests {
    stop: bool,
    reload: bool,
}

impl Requests {
    /// Takes a request.
    pub(crate) fn ask(&mut self, request: Request) {
        match request {
            Request::Stop => self.stop = true,
            Request::Reload => self.reload = true,
        }
    }

    /// The request to carry out now.
    pub(crate) fn next(&mut self) -> Option<Request> {
        if self.stop {
            return Some(Request::Stop);
        }
        std::mem::take(&mut self.reload).then_some(Request::Reload)
    }
}
