//! Whole outputs on record: what a person reads is looked at by a person when it changes.
//!
//! `INSTA_UPDATE=always cargo test --test goldens` writes `tests/snapshots/` anew. Nothing here depends on the
//! machine, the time or the folder.

use std::process::{Command, Stdio};

const VIRTUAL: &str = "rig_configs/virtual.toml";
const SMALL: &str = "rig_configs/plans/small.toml";
const SLIP: &str = "rig_configs/plans/slip.toml";

/// Standard output, standard error and exit code of a command.
fn said(args: &[&str]) -> String {
    let mut command = Command::new(env!("CARGO_BIN_EXE_twinrig"));
    command.args(args).current_dir(env!("CARGO_MANIFEST_DIR")).env("NO_COLOR", "1").env("COLUMNS", "100");
    command.env("TWINRIG_LOGS", concat!(env!("CARGO_TARGET_TMPDIR"), "/logs"));
    let output = command.env_remove("TWINRIG_LOG").stdin(Stdio::null()).output().expect("the program starts");
    let text = |bytes: &[u8]| String::from_utf8(bytes.to_vec()).expect("the program prints UTF-8");
    let (out, err) = (text(&output.stdout), text(&output.stderr));
    let told = if err.is_empty() { String::new() } else { format!("--- standard error\n{err}") };
    format!("{out}{told}--- exit code {}\n", output.status.code().expect("it ends by itself"))
}

macro_rules! golden {
    ($name:ident, $($argument:expr),+) => {
        #[test]
        fn $name() {
            insta::with_settings!({ omit_expression => true, prepend_module_to_snapshot => false }, {
                insta::assert_snapshot!(stringify!($name), said(&[$($argument),+]));
            });
        }
    };
}

golden!(overview, "--help");
golden!(collect_help, "collect", "--help");
golden!(check_small, "check", VIRTUAL, SMALL);
golden!(check_slip_as_json, "check", VIRTUAL, SLIP, "--json");
golden!(check_a_real_bench, "check", "rig_configs/skin_marlin_grbl.toml", "rig_configs/plans/rotate.toml");
golden!(check_the_press_plan, "check", "rig_configs/gelsight_printer.toml", "rig_configs/plans/press.toml");
golden!(check_beyond_the_limits, "check", VIRTUAL, SMALL, "--set", "motion.z.origin=59.5");
golden!(dry_run_small, "collect", VIRTUAL, SMALL, "--out", "nowhere", "--dry-run");
golden!(nobody_at_a_real_bench, "collect", "rig_configs/skin_marlin_grbl.toml", SLIP, "--out", "nowhere");
golden!(a_typo_in_a_setting, "collect", VIRTUAL, SMALL, "--out", "nowhere", "--set", "optics.sampels=1");
golden!(a_command_that_is_none, "colect", VIRTUAL);
golden!(a_file_that_is_not_there, "check", "rig_configs/virtul.toml", "no/where.toml");
golden!(a_press_that_was_not_meant, "move", VIRTUAL, "--z", "-0.5");
golden!(a_move_beyond_the_axis, "move", VIRTUAL, "--z", "1e308", "--home");
golden!(no_dataset, "verify", "src");
golden!(protocols, "protocol", "list");
golden!(a_protocol_with_faults, "protocol", "lint", "tests/bad_protocols/types_and_keys.toml");
