"""Parameters: a node declares them, another one sets them, and both hear what becomes of it."""

from typing import Any

from simple_ros import ParameterRefused, aio


async def main() -> None:
    async with aio.NodeHandle("driver") as driver, aio.NodeHandle("operator") as operator:
        # What the command line says (_max_speed:=3) wins over the Master, and that over the default.
        speed = await driver.declare_parameter("~max_speed", 2.0, minimum=0, maximum=10)
        await driver.declare_parameter("~mode", "careful", choices=("careful", "bold"))
        print(f"declared: {speed} m/s", flush=True)

        def judge(values: dict[str, Any]) -> str | None:
            mode = values.get("~mode", driver.parameters["~mode"])
            if mode == "careful" and values.get("~max_speed", 0) > 5:
                return "5 m/s is all a careful driver does"
            return None

        driver.on_set_parameters(judge)
        driver.on_parameter_changed("~mode", lambda mode: print(f"the mode is {mode}", flush=True))
        try:
            await operator.set_parameters({"driver/max_speed": 8})
        except ParameterRefused as refused:
            print(refused, flush=True)
        await operator.set_parameters({"driver/max_speed": 8, "driver/mode": "bold"})

        watch = await operator.watch_parameters("driver")
        async for change in watch:
            print(f"{change.name} is {change.value}", flush=True)
            if len(watch.values) == 2 and change.name == "driver/mode":
                break
        print(await operator.get_parameter("driver"), flush=True)


aio.run(main())
