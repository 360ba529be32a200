//! Commands of the user's own, run by the shell.

use std::ffi::OsStr;
use std::process::{Command, Stdio};

use crate::LabError;

/// Runs a command and waits for its end. What it writes on standard output goes nowhere; its errors are the user's to
/// see.
pub(crate) fn run_command(command: &str, variables: &[(&str, &OsStr)]) -> Result<(), LabError> {
    run(command, variables, Stdio::null()).map(|_| ())
}

/// Runs a command, and gives what it writes on standard output.
pub(crate) fn answer_of(command: &str, variables: &[(&str, &OsStr)]) -> Result<String, LabError> {
    let output = run(command, variables, Stdio::piped())?;
    Ok(String::from_utf8_lossy(&output).into_owned())
}

fn run(command: &str, variables: &[(&str, &OsStr)], output: Stdio) -> Result<Vec<u8>, LabError> {
    let failed = |problem: String| LabError::Command { command: command.into(), problem };
    let done = Command::new("sh")
        .arg("-c")
        .arg(command)
        .envs(variables.iter().copied())
        .stdin(Stdio::null())
        .stdout(output)
        .stderr(Stdio::inherit())
        .spawn()
        .and_then(std::process::Child::wait_with_output)
        .map_err(|error| failed(format!("cannot be run: {error}")))?;
    let status = done.status;
    if status.success() { Ok(done.stdout) } else { Err(failed(format!("failed: {status}"))) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn commands_get_their_variables_and_failures_are_told() {
        run_command("test \"$A\" = 'x y'", &[("A", OsStr::new("x y"))]).unwrap();
        let error = run_command("exit 3", &[]).unwrap_err().to_string();
        assert!(error.contains("exit 3") && error.contains("failed"), "{error}");
    }
}
