// A scene without an environment.

fn environment() {}
