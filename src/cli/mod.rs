//! Subcommands: what each one's arguments are, and the dispatch.

use std::process::ExitCode;

use clap::{CommandFactory, FromArgMatches, Parser, Subcommand};

mod bake;
mod bench;
mod cache;
mod characters;
mod demo;
mod export;
mod impostors;
mod inspect;
mod measure;
mod output;
mod picture;
mod render;
mod shot;
mod source;

#[derive(Parser)]
#[command(
    name = "throng",
    version,
    about = "Draws huge animated crowds in Vulkan with a handful of draw calls",
    long_about = "Draws huge animated crowds in Vulkan with a handful of draw calls, on a GPU or, through Mesa's \
                  lavapipe, on two CPU cores.\n\nA character file is baked once: into continuous levels of detail that \
                  hold in all of its animations. A scene of any number of agents is then drawn with one instanced draw \
                  per submesh.",
    after_help = "Try it:\n  \
                  throng demo                                       10,000 people on a plaza, to out/demo.png\n  \
                  throng render --character fox.glb -o fox.png      a picture of a character of your own\n  \
                  throng bake fox.glb -o fox.throng                 bake it\n  \
                  throng inspect fox.throng                         what its levels of detail are\n  \
                  throng render plaza --character fox.throng --agents 5000 -o foxes.png\n\n\
                  Exit status: 0 all is well, 1 a check failed, 2 an error."
)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    Bake(bake::Arguments),
    Inspect(inspect::Arguments),
    Export(export::Arguments),
    Render(render::Arguments),
    Demo(demo::Arguments),
    Characters(characters::Arguments),
    Bench(bench::Arguments),
}

/// The whole command line. A number below zero is a value of its option, refused as such, and no option of its own.
fn command() -> clap::Command {
    Arguments::command().mut_subcommands(|command| {
        command.mut_args(|a| {
            let takes_value = a.get_action().takes_values() && a.get_long().is_some();
            a.allow_negative_numbers(takes_value)
        })
    })
}

/// Parses the arguments, runs the command and says what went wrong.
pub fn main() -> ExitCode {
    // Usage errors end the program here, with status 2.
    let matches = command().get_matches();
    let arguments = Arguments::from_arg_matches(&matches).unwrap_or_else(|e| e.exit());
    let result = match &arguments.command {
        Command::Bake(a) => bake::run(a),
        Command::Inspect(a) => inspect::run(a),
        Command::Export(a) => export::run(a),
        Command::Render(a) => render::run(a),
        Command::Demo(a) => demo::run(a),
        Command::Characters(a) => characters::run(a),
        Command::Bench(a) => bench::run(a),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(e) => {
            eprintln!("throng: {e}");
            ExitCode::from(2)
        }
    }
}
