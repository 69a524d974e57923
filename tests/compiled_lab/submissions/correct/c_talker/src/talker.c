// Publishes a numbered text at 20 Hz, until the service /enable turns it off.
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>

#include <rcl/error_handling.h>
#include <rcl/rcl.h>
#include <rosidl_runtime_c/string_functions.h>
#include <std_msgs/msg/string.h>
#include <std_srvs/srv/set_bool.h>

static volatile sig_atomic_t is_running = 1;
static bool is_enabled = true;
static int count = 0;

static void stop(int number) {
  (void)number;
  is_running = 0;
}

// Ends the program if a call of ROS failed.
static void require(rcl_ret_t status) {
  if (status != RCL_RET_OK) {
    fprintf(stderr, "failed: %s\n", rcl_get_error_string().str);
    exit(1);
  }
}

static void publish(const rcl_publisher_t *publisher) {
  std_msgs__msg__String message;
  char text[32];
  snprintf(text, sizeof text, "hello %d", count++);
  std_msgs__msg__String__init(&message);
  rosidl_runtime_c__String__assign(&message.data, text);
  require(rcl_publish(publisher, &message, NULL));
  std_msgs__msg__String__fini(&message);
}

static void answer(const rcl_service_t *service) {
  std_srvs__srv__SetBool_Request request;
  std_srvs__srv__SetBool_Response response;
  rmw_request_id_t id;
  std_srvs__srv__SetBool_Request__init(&request);
  std_srvs__srv__SetBool_Response__init(&response);
  require(rcl_take_request(service, &id, &request));
  is_enabled = request.data;
  response.success = true;
  rosidl_runtime_c__String__assign(&response.message, is_enabled ? "on" : "off");
  require(rcl_send_response(service, &id, &response));
  std_srvs__srv__SetBool_Request__fini(&request);
  std_srvs__srv__SetBool_Response__fini(&response);
}

int main(int argc, char **argv) {
  rcl_allocator_t allocator = rcl_get_default_allocator();
  rcl_init_options_t options = rcl_get_zero_initialized_init_options();
  rcl_context_t context = rcl_get_zero_initialized_context();
  rcl_node_t node = rcl_get_zero_initialized_node();
  rcl_node_options_t node_options = rcl_node_get_default_options();
  rcl_publisher_t publisher = rcl_get_zero_initialized_publisher();
  rcl_publisher_options_t publisher_options = rcl_publisher_get_default_options();
  rcl_service_t service = rcl_get_zero_initialized_service();
  rcl_service_options_t service_options = rcl_service_get_default_options();
  rcl_timer_t timer = rcl_get_zero_initialized_timer();
  rcl_wait_set_t waiting = rcl_get_zero_initialized_wait_set();
  rcl_clock_t clock;

  signal(SIGINT, stop);
  require(rcl_init_options_init(&options, allocator));
  require(rcl_init(argc, (const char *const *)argv, &options, &context));
  require(rcl_node_init(&node, "talker", "", &context, &node_options));
  require(rcl_publisher_init(&publisher, &node, ROSIDL_GET_MSG_TYPE_SUPPORT(std_msgs, msg, String),
                             "chatter", &publisher_options));
  require(rcl_service_init(&service, &node, ROSIDL_GET_SRV_TYPE_SUPPORT(std_srvs, srv, SetBool),
                           "enable", &service_options));
  require(rcl_clock_init(RCL_STEADY_TIME, &clock, &allocator));
  require(rcl_timer_init2(&timer, &clock, &context, RCL_MS_TO_NS(50), NULL, allocator, true));
  require(rcl_wait_set_init(&waiting, 0, 0, 1, 0, 1, 0, &context, allocator));
  while (is_running) {
    require(rcl_wait_set_clear(&waiting));
    require(rcl_wait_set_add_timer(&waiting, &timer, NULL));
    require(rcl_wait_set_add_service(&waiting, &service, NULL));
    if (rcl_wait(&waiting, RCL_MS_TO_NS(200)) != RCL_RET_OK) {
      rcl_reset_error();
      continue;
    }
    if (waiting.timers[0] != NULL && rcl_timer_call(&timer) == RCL_RET_OK && is_enabled) {
      publish(&publisher);
    }
    if (waiting.services[0] != NULL) {
      answer(&service);
    }
  }
  require(rcl_wait_set_fini(&waiting));
  require(rcl_timer_fini(&timer));
  require(rcl_clock_fini(&clock));
  require(rcl_service_fini(&service, &node));
  require(rcl_publisher_fini(&publisher, &node));
  require(rcl_node_fini(&node));
  require(rcl_shutdown(&context));
  require(rcl_context_fini(&context));
  return 0;
}
