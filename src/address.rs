//! Where masters are.

/// Port that masters listen on and tiles look for.
pub const DEFAULT_PORT: u16 = 7467;

/// Host and port, with [`DEFAULT_PORT`] where none is given.
pub fn with_port(master: &str) -> String {
    let has_port = master
        .rsplit_once(':')
        .is_some_and(|(host, port)| port.parse::<u16>().is_ok() && (!host.contains(':') || host.ends_with(']')));
    match (has_port, master.contains(':') && !master.starts_with('[')) {
        (true, _) => master.to_owned(),
        (false, true) => format!("[{master}]:{DEFAULT_PORT}"),
        (false, false) => format!("{master}:{DEFAULT_PORT}"),
    }
}

#[cfg(test)]
mod tests {
    use super::with_port;

    #[test]
    fn the_port_may_be_left_out() {
        let cases = [
            ("wall-master", "wall-master:7467"),
            ("wall-master:80", "wall-master:80"),
            ("10.0.0.1", "10.0.0.1:7467"),
            ("::1", "[::1]:7467"),
            ("[::1]", "[::1]:7467"),
            ("[::1]:80", "[::1]:80"),
        ];
        for (given, wanted) in cases {
            assert_eq!(with_port(given), wanted);
        }
    }
}
